"""Log-probabilities: their measure, their ratios, and that a dataset's can be computed again."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SchemaError
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.registry.recipes import checkpoints
from swarmdata.rollouts.action_probabilities import noisy_log_probs, uniform_log_probs
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.comparing import act_on
from swarmdata.types import Double, Episode, Float, Step

MEAN = st.floats(-1.5, 1.5)
NOISE = st.floats(0.05, 2.0)


def log_probs(mean: float, noise: float, actions: Double) -> Double:
    """Of one robot with one component, of each action [n]."""
    joint = actions.astype(np.float32)[:, None, None]
    means = np.full(joint.shape, mean)
    return noisy_log_probs(means, joint, noise)[:, 0].astype(np.float64)


def inner_grid(n: int = 20_001) -> Double:
    """Midpoints of equal cells of (-1, 1)."""
    return np.asarray((np.arange(n) + 0.5) * (2.0 / n) - 1.0, dtype=np.float64)


@given(mean=MEAN, noise=NOISE)
def test_density_and_masses_sum_to_one(mean: float, noise: float) -> None:
    inside = np.exp(log_probs(mean, noise, inner_grid())).mean() * 2.0
    masses = np.exp(log_probs(mean, noise, np.array([-1.0, 1.0]))).sum()
    assert inside + masses == pytest.approx(1.0, abs=1e-5)


@given(mean=MEAN, noise=NOISE)
def test_masses_are_the_frequencies_of_clipped_draws(mean: float, noise: float) -> None:
    draws = np.clip(mean + noise * np.random.default_rng(0).normal(size=100_000), -1.0, 1.0)
    for bound in (-1.0, 1.0):
        mass = float(np.exp(log_probs(mean, noise, np.array([bound]))[0]))
        assert abs((draws == bound).mean() - mass) < 5.0 * np.sqrt(mass / len(draws)) + 1e-4


def test_importance_weights_turn_one_policy_into_another() -> None:
    actions = np.clip(0.7 + 0.4 * np.random.default_rng(1).normal(size=200_000), -1.0, 1.0)
    weights = np.exp(log_probs(0.9, 0.3, actions) - log_probs(0.7, 0.4, actions))
    assert weights.mean() == pytest.approx(1.0, abs=0.01)
    target = np.clip(0.9 + 0.3 * np.random.default_rng(2).normal(size=200_000), -1.0, 1.0)
    actions = actions.astype(np.float32).astype(np.float64)
    assert (weights * actions).mean() == pytest.approx(target.mean(), abs=0.01)
    assert (weights * (actions == 1.0)).mean() == pytest.approx((target == 1.0).mean(), abs=0.01)


def test_components_add_up_and_messages_that_are_never_sent_are_zeros() -> None:
    rng = np.random.default_rng(3)
    means = rng.uniform(-1.0, 1.0, size=(6, 2, 2))
    actions = np.zeros((6, 2, 4), dtype=np.float32)
    actions[..., :2] = np.clip(means + 0.1 * rng.normal(size=means.shape), -1.0, 1.0)
    each = [noisy_log_probs(means[..., [k]], actions[..., [k]], 0.1) for k in range(2)]
    whole = noisy_log_probs(means, actions, 0.1)
    np.testing.assert_allclose(whole, each[0] + each[1], rtol=1e-5, atol=1e-6)
    actions[2, 1, 3] = 0.1
    assert noisy_log_probs(means, actions, 0.1)[2, 1] == -np.inf


def test_without_noise_only_the_chosen_action_is_possible() -> None:
    means = np.array([[[0.1, 2.0], [0.1, -0.3]]])
    actions = np.array([[[0.1, 1.0], [0.1, -0.2]]], dtype=np.float32)
    assert noisy_log_probs(means, actions, 0.0).tolist() == [[0.0, -np.inf]]


def test_uniform_is_the_area_of_the_square() -> None:
    actions = np.array([[[0.1, -1.0], [1.5, 0.0]]], dtype=np.float32)
    expected = np.float32(-np.log(4.0))
    assert uniform_log_probs(actions).tolist() == [[expected, -np.inf]]
    assert noisy_log_probs(np.zeros((1, 2, 2)), actions, 0.5)[0, 1] == -np.inf


@given(data=st.data(), noise=NOISE)
def test_a_robot_has_the_same_bits_in_any_batch(data: st.DataObject, noise: float) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 1000)))
    means = rng.uniform(-1.2, 1.2, size=(7, 3, 2))
    actions = np.clip(means + noise * rng.normal(size=means.shape), -1, 1).astype(np.float32)
    whole = noisy_log_probs(means, actions, noise)
    row = data.draw(st.integers(0, 6))
    part = noisy_log_probs(means[row : row + 1], actions[row : row + 1], noise)
    assert part.tobytes() == whole[row : row + 1].tobytes()


SPEC = preset("coop_nav")
EXPERT = checkpoints("coop_nav", "expert")[0]
SOURCES: list[tuple[str, dict[str, Any]]] = [
    ("random", {}),
    ("idle", {}),
    ("straight", {}),
    ("learned", {"checkpoint": EXPERT.file, "sha256": EXPERT.sha256, "noise": 0.3}),
    ("learned", {"checkpoint": EXPERT.file, "sha256": EXPERT.sha256}),
]


def recorded_steps(episode: Episode, spec: TaskSpec) -> Step:
    """Every step of an episode as a copy of its own, [T, ...]: what acted policies saw."""
    n = len(episode)
    blank = make_env(spec, 1).reset(np.array([episode.seed], np.uint64))
    fields = {name: np.repeat(np.asarray(array), n, axis=0) for name, array in zip(
        Step._fields, blank, strict=True)}  # fmt: skip
    fields |= {"observations": episode.observations[:-1], "states": episode.states[:-1]}
    return Step(**{**fields, "times": np.arange(n)})


@pytest.mark.parametrize(("name", "options"), SOURCES)
def test_a_stored_episode_gives_its_log_probs_again(name: str, options: dict[str, Any]) -> None:
    policy = make_policy(name, SPEC, **options)
    (episode,) = rollout(make_env(SPEC, 1), policy, np.array([5], np.uint64))
    fresh = make_policy(name, SPEC, **options)
    again = fresh.log_probs(recorded_steps(episode, SPEC), episode.actions)
    assert again.tobytes() == episode.log_probs.tobytes()
    if options.get("noise"):
        assert (np.abs(episode.actions) == 1.0).any()
        assert episode.log_probs.std() > 0.5


def test_a_policy_with_memory_answers_for_its_last_step_only() -> None:
    spec = SPEC.with_updates(horizon=5)
    env = make_env(spec, 2)
    policy = make_policy("scripted", spec, noise=0.2)
    step = env.reset(np.array([3, 4], np.uint64))
    actions = act_on(policy, step)
    assert np.isfinite(policy.log_probs(step, actions)).all()
    certain = make_policy("scripted", spec)
    act_on(certain, step)
    assert not np.isfinite(certain.log_probs(step, actions)).any()
    with pytest.raises(SchemaError, match="another step than the last call of act"):
        policy.log_probs(step._replace(times=step.times + 1), actions)


def test_the_network_runs_once_for_act_and_log_probs(monkeypatch: pytest.MonkeyPatch) -> None:
    from swarmdata.behavior_policies import exact_actor, learned

    calls: list[int] = []

    def counted(actor: exact_actor.Actor, observations: Float) -> Double:
        calls.append(len(observations))
        return exact_actor.forward(actor, observations)

    monkeypatch.setattr(learned, "forward", counted)
    policy = make_policy("learned", SPEC, **SOURCES[3][1])
    step = make_env(SPEC, 2).reset(np.array([3, 4], np.uint64))
    first = policy.log_probs(step, policy.act(step))
    assert len(calls) == 1
    other = step._replace(times=step.times + 1)
    policy.act(other)
    assert policy.log_probs(step, policy.act(step)).tobytes() == first.tobytes()
