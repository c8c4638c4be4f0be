"""From a recording to a policy and back into its environment, in the environment's units."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata import FunctionPolicy
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError, SpecError
from swarmdata.evaluation.results.result_files import Result, load_result, save_result
from swarmdata.record import (
    evaluate_parallel,
    foreign_evaluation_seeds,
    policy_actions,
    step_of,
)
from swarmdata.specs.origins import RecordedSpec
from swarmdata.specs.spaces import Limits
from swarmdata.types import Float, Seeds, Step
from tests.record.worlds import (
    Choosing,
    Constant,
    Counting,
    Reaching,
    Seeing,
    record,
    spec_of,
    steady,
)

torch = pytest.importorskip("torch")


def constant(value: float) -> Constant:
    return Constant([value] * 2, [value] * 2)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return record(Counting(leaves={"big": 3}), tmp_path_factory.mktemp("recorded") / "ds")


@pytest.fixture(scope="module")
def spec(dataset: Dataset) -> RecordedSpec:
    return spec_of(dataset)


def test_samples_are_in_the_unit_cube_and_episodes_are_as_recorded(dataset: Dataset) -> None:
    raw, unit = dataset.transitions()["actions"], next(dataset.sampler(500)).actions
    assert raw[:, 0].max() > 1
    assert np.abs(unit).max() <= 1
    assert unit.dtype == np.float32
    sampler = dataset.sampler(7)
    index = sampler.draw()
    stored = dataset.stored.arrays["actions"][index]
    alive = dataset.stored.arrays["alive"][index + sampler.rows.episode[index]]
    middle, half = np.array([[0, 2], [3, 0]]), np.array([[2, 2], [2, 1]])
    expected = np.where(alive[..., None], (stored - middle) / half, 0)
    np.testing.assert_allclose(sampler.gather(index).actions, expected, atol=1e-6)


def test_windows_have_zeros_behind_the_end(dataset: Dataset) -> None:
    batch = next(dataset.sampler(64, horizon=6))
    assert not batch.mask.all()
    assert not batch.actions[~batch.mask].any()
    assert np.abs(batch.actions[batch.mask]).max() <= 1


@pytest.mark.parametrize("value", [-1.0, 0.0, 1.0, 7.0])
def test_actions_come_back_in_the_units_of_the_environment(
    spec: RecordedSpec, value: float
) -> None:
    step = step_of(np.zeros((2, 3), np.float32), np.zeros(2, np.float32), seed=0, time=0)
    actions = policy_actions(constant(value), spec, step)
    unit = np.clip(value, -1, 1)
    np.testing.assert_array_equal(actions["big"], np.array([0, 2]) + 2 * unit)
    np.testing.assert_array_equal(actions["small"], [3 + 2 * unit])
    for name, action in actions.items():
        assert Counting().action_space(name).contains(action)


def test_a_policy_sees_what_was_recorded(dataset: Dataset, spec: RecordedSpec) -> None:
    policy = constant(0.0)
    episode = dataset[0]
    result = evaluate_parallel(
        policy, lambda: Counting(leaves={"big": 3}), spec, dataset.episodes.seeds[:1]
    )
    seen = np.concatenate([step.observations for step in policy.seen[1:]])
    np.testing.assert_array_equal(seen, episode.observations[:-1])
    np.testing.assert_array_equal(policy.seen[-1].states[0], episode.states[-2])
    assert [int(step.times[0]) for step in policy.seen[1:]] == [0, 1, 2, 3]
    assert result.metrics["return"].tolist() == [1 + 2 + 3 + 4 / 2]
    assert result.metrics["length"].tolist() == [4]
    assert np.isnan(result.metrics["success"]).all()


@pytest.mark.parametrize("failed", ["small", "big", None])
def test_an_agent_that_left_early_counts_in_success(spec: RecordedSpec, failed: str | None) -> None:
    told = {name: name != failed for name in ("big", "small")}
    played = evaluate_parallel(
        constant(0.0),
        lambda: Counting(terminates=True, leaves={"small": 2}, success=told),
        spec,
        foreign_evaluation_seeds(2),
    )
    assert played.metrics["success"].tolist() == [failed is None] * 2


def test_a_policy_acts_on_one_thread_and_the_environment_has_its_own(spec: RecordedSpec) -> None:
    acting, stepping = [], []

    class Policy(Constant):
        def act(self, step: Step) -> Float:
            acting.append(torch.get_num_threads())
            return super().act(step)

    class Env(Counting):
        def step(self, actions: Any) -> Any:
            stepping.append(torch.get_num_threads())
            return super().step(actions)

    before = torch.get_num_threads()
    torch.set_num_threads(3)
    try:
        evaluate_parallel(Policy([0.0] * 2, [0.0] * 2), Env, spec, foreign_evaluation_seeds(1))
    finally:
        torch.set_num_threads(before)
    assert set(acting) == {1}
    assert set(stepping) == {3}


def test_another_environment_is_refused(spec: RecordedSpec) -> None:
    seeds = foreign_evaluation_seeds(1)
    with pytest.raises(SchemaError, match="the recording of counting_v1 has"):
        evaluate_parallel(constant(0.0), Choosing, spec, seeds)
    with pytest.raises(SchemaError, match="no seeds"):
        evaluate_parallel(constant(0.0), Counting, spec, seeds[:0])


@pytest.mark.parametrize("algorithm", ["bc", "maddpg_bc"])
def test_algorithms_train_on_a_recording(
    dataset: Dataset, spec: RecordedSpec, tmp_path: Path, algorithm: str
) -> None:
    from swarmdata.evaluation.results.policy_names import find_target
    from swarmdata.evaluation.runs.train import train
    from swarmdata.evaluation.runs.trained_policies import read_trained
    from swarmdata.learn.training.run_folder import load_run

    changes = {"n_updates": "20", "batch_size": "32"}
    policies = train(
        algorithm, str(dataset.path), tmp_path / "run", n_seeds=2, changes=changes, progress=False
    )
    who = read_trained(tmp_path / "run").provenances[0]
    seeds = foreign_evaluation_seeds(2)
    result = evaluate_parallel(policies[0], Counting, spec, seeds)
    assert np.isfinite(result.metrics["return"]).all()
    again = evaluate_parallel(load_run(tmp_path / "run")[0], Counting, spec, seeds)
    np.testing.assert_array_equal(again.metrics["return"], result.metrics["return"])
    assert not (tmp_path / "run" / "curve.csv").exists()
    kept = load_result(
        save_result(Result(replace(result, policy="run"), who, spec), tmp_path / "out")
    )
    assert (kept.provenance.dataset, kept.provenance.updates) == (dataset.id, 20)
    assert kept.evaluation.metrics["return"].tolist() == result.metrics["return"].tolist()
    with pytest.raises(SpecError, match="evaluate_parallel"):
        find_target(str(tmp_path / "run"))


@pytest.fixture(scope="module")
def reached(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """What an expert did, who acts as it observes."""
    env = Reaching()
    path = tmp_path_factory.mktemp("reached") / "ds"
    return record(env, path, 10, lambda agent, _: env.best[agent].astype(np.float32))


def cloned(observations: Float, actions: Float) -> Any:
    """Behavior cloning of rows [n, N, ...] by least squares: a function of observations."""
    ones = np.ones((*observations.shape[:2], 1))
    inputs = np.concatenate([observations, ones], -1).transpose(1, 0, 2)  # [N, n, O + 1]
    weights = np.stack(
        [
            np.linalg.lstsq(x, y, rcond=None)[0]
            for x, y in zip(inputs, actions.swapaxes(0, 1), strict=True)
        ]
    )
    return lambda seen: np.einsum("eno,noa->ena", seen, weights[:, :-1]) + weights[:, -1]


def own_score(act: Any, seeds: Seeds) -> list[float]:
    """Team returns of a function in a loop that does not use the library."""
    env, scores = Reaching(), []
    for seed in seeds.tolist():
        observations, _ = env.reset(seed=seed)
        scores.append(0.0)
        while env.agents:
            rows = act(np.stack([observations[name] for name in env.agents])[None])[0]
            observations, rewards, *_ = env.step(dict(zip(env.agents, rows, strict=True)))
            scores[-1] += float(np.mean(list(rewards.values())))
    return scores


def test_a_function_that_learned_from_episodes_scores_as_in_a_loop_of_its_own(
    reached: Dataset,
) -> None:
    rows, seeds = reached.transitions(), foreign_evaluation_seeds(3)
    act = cloned(rows["observations"], rows["actions"])
    policy = FunctionPolicy(act, units=reached.spec)
    result = evaluate_parallel(policy, Reaching, spec_of(reached), seeds)
    np.testing.assert_allclose(result.metrics["return"], own_score(act, seeds), atol=1e-5)
    assert result.metrics["return"].min() > -1e-4, "it does as the expert, who loses nothing"


def test_a_function_that_learned_from_batches_scores_the_same(reached: Dataset) -> None:
    batch, seeds = next(reached.sampler(256)), foreign_evaluation_seeds(3)
    policy = FunctionPolicy(cloned(batch.observations, batch.actions), units="unit")
    result = evaluate_parallel(policy, Reaching, spec_of(reached), seeds)
    assert result.metrics["return"].min() > -1e-4


def test_a_function_without_units_is_refused_where_they_matter(
    reached: Dataset, tmp_path: Path
) -> None:
    seeds = foreign_evaluation_seeds(1)
    policy = FunctionPolicy(lambda seen: seen)
    with pytest.raises(SchemaError, match=r"reaching_v0 have other bounds .* units=dataset.spec"):
        evaluate_parallel(policy, Reaching, spec_of(reached), seeds)
    seen = record(Seeing(), tmp_path / "ds", 2)
    still = FunctionPolicy(lambda rows: np.zeros((*rows.shape[:2], 2)))
    result = evaluate_parallel(still, Seeing, spec_of(seen), seeds)
    assert np.isfinite(result.metrics["return"]).all(), "its bounds are -1 and 1"


@pytest.mark.slow
def test_behavior_cloning_finds_the_actions_again(tmp_path: Path) -> None:
    """Actions say the time, and so do observations."""
    from swarmdata.learn.training.trainer import train_seeds
    from swarmdata.offline_algos.bc import BC

    dataset = record(Counting(), tmp_path / "ds", 20, steady)
    config = BC.Config(n_updates=400, batch_size=64)
    policy = train_seeds(
        "bc", dataset, tmp_path / "run", seeds=(0,), config=config, progress=False
    )[0]
    for time in range(4):
        rows, state = dataset[0].observations[time], dataset[0].states[time]
        step = step_of(rows, state, seed=0, time=time)
        chosen = policy_actions(policy, spec_of(dataset), step)
        for name, action in chosen.items():
            np.testing.assert_allclose(action, steady(name, time), atol=0.3)


def test_choices_beside_numbers_cannot_be_learned(tmp_path: Path) -> None:
    from swarmdata.learn.training.trainer import train_seeds

    dataset = record(Choosing(), tmp_path / "ds", 5)
    sample = next(dataset.sampler(4))
    assert sample.actions.max() > 1, "choices come as they are"
    with pytest.raises(
        SchemaError,
        match=r"mixed .* have a continuous part .* either continuous actions or choices",
    ):
        train_seeds("bc", dataset, tmp_path / "run", progress=False)


def test_actions_outside_their_bounds_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a recording by an older version, which accepted them."""
    monkeypatch.setattr(Limits, "check", lambda *_: None)
    dataset = record(
        Counting(), tmp_path / "ds", 5, lambda agent, _: np.full(1 + (agent == "big"), 4.0, "f4")
    )
    with pytest.raises(SchemaError, match="action of agent 0 is 4, outside of 0 ± 2"):
        next(dataset.sampler(8))
