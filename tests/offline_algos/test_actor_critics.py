"""What the two-stage actor-critics have in common: targets, losses, stages, what moves when."""

from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
import torch
from torch import Tensor

from swarmdata.learn.networks.critics import RobotView
from swarmdata.learn.training.actor_critic import Extraction, ExtractionConfig, Valuer
from swarmdata.offline_algos.omar import by_agent
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from swarmdata.types import Batch
from tests.offline_algos.toys import made, random_batch, two_episodes
from tests.support.pairs import once_each

KINDS: dict[str, Any] = {
    name: resolve("algorithm", OFFLINE_ALGORITHMS, name)
    for name in ("maddpg_bc", "matd3", "facmac_bc", "maddpg_cql", "cfcql", "icql_qs", "omar")
}
SECOND = [name for name in get_args(Extraction) if name != "joint"]

ROBOTS = ("maddpg_bc", "matd3", "maddpg_cql", "cfcql", "icql_qs")
"""Those with critics of each robot that see the state."""

each = pytest.mark.parametrize("name", KINDS)
penalized = pytest.mark.parametrize("name", ["cfcql", "maddpg_cql"])
by_robot = pytest.mark.parametrize("name", ["maddpg_bc", "cfcql"])
gradients = pytest.mark.parametrize("joint_gradient", ["all", "own"])


def make(name: str, n_seeds: int = 1, **settings: Any) -> Any:
    """An untrained algorithm of one stage, unless the settings say otherwise."""
    return made(KINDS[name], n_seeds, **{"extraction": "joint", **settings})


def targets_of(algorithm: Any, batch: Batch) -> Tensor:
    """Targets by row, and by robot if critics are of robots, [rows]."""
    is_smoothed_outside = isinstance(algorithm, KINDS["maddpg_bc"])
    y: Tensor = algorithm.targets(
        batch, *((torch.zeros_like(batch.actions),) if is_smoothed_outside else ())
    )
    return y.flatten()


def moved(before: dict[str, Tensor], after: dict[str, Tensor]) -> set[str]:
    return {name for name, value in before.items() if not torch.equal(value, after[name])}


def state(part: Any) -> dict[str, Tensor]:
    return {name: value.clone() for name, value in part.state_dict().items()}


def test_every_algorithm_with_a_second_stage_is_here() -> None:
    kinds = {name: resolve("algorithm", OFFLINE_ALGORITHMS, name) for name in OFFLINE_ALGORITHMS}
    assert {n for n, k in kinds.items() if issubclass(k.Config, ExtractionConfig)} == set(KINDS)


REWARDS = [(name, reward) for name in ROBOTS for reward in ("own", "team")]


@pytest.mark.parametrize(("name", "reward"), [*REWARDS, ("facmac_bc", "team")])
def test_targets_of_two_episodes_are_exact(
    name: str, reward: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """V(s) = 100 episode + 10 time: a bootstrap across an end would be off by 60 or more."""
    settings: dict[str, Any] = {"reward": reward} if name in ROBOTS else {}
    algorithm = make(name, discount=0.5, **settings)

    def value(x: RobotView | Tensor, *_: Tensor) -> Tensor:
        states = x.features[..., -4:] if isinstance(x, RobotView) else x
        v = 100 * states[..., 0] + 10 * states[..., 1]
        return torch.stack([v, v + 1], 1)  # the smaller twin counts

    monkeypatch.setattr(algorithm.critics, "target_q", value)
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()
    rewards = batch.rewards
    if reward == "team":
        rewards = rewards.mean(-1, keepdim=True).expand_as(rewards)
    # episode 1: r + V(1, 1) / 2, then r without a bootstrap; episode 2: the cut does not stop it
    expected = rewards + torch.tensor([[55.0, 0.0, 105.0, 110.0]])[..., None]
    if name == "facmac_bc":
        expected = expected[..., 0]
    torch.testing.assert_close(targets_of(algorithm, batch), expected.flatten())


@each
@pytest.mark.parametrize(("clip", "low", "worth"), [(True, 1, 1), (True, 2, 1.5), (False, 2, 2)])
def test_targets_take_the_smaller_twin_the_reward_scale_and_the_bound(
    name: str, clip: bool, low: float, worth: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    changes = {"return_std": 2.0, "own_return_std": 2.0, "max_return": 3.0, "own_max_return": 3.0}
    algorithm, batch = make(name, changes=changes, discount=0.9, clip_target=clip), random_batch()
    true = algorithm.critics.target_q

    def constant(*arguments: Any) -> Tensor:
        one = true(*arguments)[:, 0]
        return torch.stack([torch.full_like(one, 5.0), torch.full_like(one, low)], 1)

    monkeypatch.setattr(algorithm.critics, "target_q", constant)
    rewards = batch.rewards.mean(-1, keepdim=True) if name == "facmac_bc" else batch.rewards
    expected = rewards / 2 + 0.9 * worth * ~batch.terminations[..., None]
    torch.testing.assert_close(targets_of(algorithm, batch), expected.flatten())


@each
def test_twins_begin_apart_and_both_learn(name: str) -> None:
    algorithm = make(name, 2)
    before = state(algorithm.critics)
    algorithm.update(random_batch(2))
    after = algorithm.critics.state_dict()
    network = "utilities" if name == "facmac_bc" else "critics"
    assert not torch.equal(*before[network][:2])
    changes = after[network] - before[network]
    assert changes.abs().amax(1).min() > 0
    assert not torch.equal(*changes[:2])


@each
def test_the_actors_step_leaves_the_critics_alone(name: str) -> None:
    algorithm, batch = make(name), random_batch()
    critics, actor = state(algorithm.critics), algorithm.actor.online.network.flat.clone()
    algorithm.actor_step(batch, algorithm.critic_inputs(batch), 1.0, is_warmup=False)
    assert not moved(critics, algorithm.critics.state_dict())
    assert not torch.equal(algorithm.actor.online.network.flat, actor)


@each
def test_the_critics_step_leaves_the_actors_alone(name: str) -> None:
    algorithm, batch = make(name, policy_delay=2), random_batch()
    actor = state(algorithm.actor)
    algorithm.update(batch)
    assert not moved(actor, algorithm.actor.state_dict())


@each
def test_the_warmup_clones_and_then_the_delay_counts(name: str) -> None:
    """Slow copies follow when the actors move."""
    algorithm, batch = make(name, n_updates=8, bc_warmup_share=0.25, policy_delay=2), random_batch()
    losses, follows = [], []
    for _ in range(4):
        slow = algorithm.actor.target.flat.clone()
        losses.append(set(algorithm.update(batch)) - {"critic_loss", "gap", "q"})
        follows.append(not torch.equal(algorithm.actor.target.flat, slow))
    later = losses.pop()
    assert losses == [{"bc_loss"}, {"bc_loss"}, set()]
    assert {"bc_loss", "policy_q"} <= later
    assert follows == [True, True, False, True]


@penalized
@gradients
@pytest.mark.parametrize("factor", [1.0, 50.0])  # of values, below and above 1 in size
def test_the_actors_loss_is_the_written_one(name: str, joint_gradient: str, factor: float) -> None:
    """Values below 1 in size are not blown up: without the floor, noise would decide."""
    algorithm, batch = make(name, joint_gradient=joint_gradient, bc_weight=0.3), random_batch()
    with torch.no_grad():
        algorithm.critics.online.layers[-1].weight.mul_(factor)
    x, pi = algorithm.critic_inputs(batch), algorithm.actor(batch.observations)
    q = torch.stack([
        algorithm.critics.q(x, alone(pi, batch.actions, robot, joint_gradient))[:, 0, :, robot]
        for robot in range(2)
    ], -1)  # fmt: skip
    size = q.abs().mean().item()
    assert (size > 1) == (factor > 1)
    loss = algorithm.actor_loss(batch, x, pi, torch.tensor([2.0])).total
    expected = 0.3 * 2.0 - q.mean().item() / max(size, 1.0)
    assert loss.item() == pytest.approx(expected, rel=1e-4)


def alone(pi: Tensor, actions: Tensor, robot: int, joint_gradient: str) -> Tensor:
    """The joint action in a robot's value: all of the policies', or its own among the data's."""
    joint = pi.clone() if joint_gradient == "all" else actions.clone()
    joint[:, :, robot] = pi[:, :, robot]
    return joint


@by_robot
@gradients
def test_the_second_stage_values_what_the_joint_gradient_says(
    name: str, joint_gradient: str
) -> None:
    algorithm, batch = make(name, joint_gradient=joint_gradient), random_batch()
    x, pi = algorithm.critic_inputs(batch), algorithm.actor(batch.observations)
    valuer = algorithm.valuer(batch, x)
    of_policy, of_data = valuer.of_policy(pi), valuer.of_candidates(batch.actions[..., None, :])
    for robot in range(2):
        q = algorithm.critics.q(x, alone(pi, batch.actions, robot, joint_gradient)).amin(1)
        torch.testing.assert_close(of_policy[..., robot], q[..., robot])
    torch.testing.assert_close(of_data[..., 0], algorithm.critics.q(x, batch.actions).amin(1))


@pytest.mark.parametrize("name", ["cfcql", "maddpg_cql", "omar"])
def test_each_critic_is_penalized_for_its_own_values(name: str) -> None:
    """og-marl's second critic was penalized for the first one's samples."""
    algorithm, batch = make(name), random_batch()
    x = algorithm.critic_inputs(batch)
    for critic in range(2):
        if name == "omar":
            actions = by_agent(batch.actions)
            gap = algorithm.gap(x, actions, algorithm.critics.q(x, actions)[..., 0], None)
        else:
            gap = algorithm.gap(batch, x, algorithm.critics.q(x, batch.actions))
        assert gap.shape == (1, 2)
        algorithm.critics.online.backward(gap[0, critic])
        steep = algorithm.critics.online.gradient.abs().sum(1)
        assert steep[critic] > 0
        assert steep[1 - critic] == 0


@penalized
def test_a_row_is_not_penalized_beyond_its_limit(name: str) -> None:
    """Where the data's action is worth much more than all others, the penalty has no gradient."""
    batch, steep = random_batch(1, 64), {}
    for limit in (1.0, 1e9):
        algorithm = make(name, gap_limit=limit)
        x = algorithm.critic_inputs(batch)
        q = algorithm.critics.q(x, batch.actions) + 50.0  # far above any sample
        algorithm.critics.online.backward(algorithm.gap(batch, x, q).sum())
        steep[limit] = algorithm.critics.online.gradient.abs().max().item()
    assert steep[1.0] == 0.0
    assert steep[1e9] > 0.0


@penalized
def test_the_penalty_prefers_the_data(name: str) -> None:
    """Rewards do not depend on actions: only the penalty can tell the data's from others."""
    g = torch.Generator().manual_seed(0)
    batch = random_batch(1, 64)
    batch.actions[...] = 0.5 + 0.05 * torch.randn(batch.actions.shape, generator=g)
    batch.rewards[...] = 0.0
    batch.terminations[...] = True

    def preference(cql_weight: float) -> float:
        algorithm = make(
            name, cql_weight=cql_weight, critic_learning_rate=1e-2, bc_warmup_share=1.0
        )
        for _ in range(30):
            algorithm.update(batch)
        x = algorithm.critic_inputs(batch)
        data, opposite = (algorithm.critics.q(x, a).mean() for a in (batch.actions, -batch.actions))
        return (data - opposite).item()

    assert preference(1.0) > preference(0.0) + 0.1


def in_two_stages(name: str, n_made: int, **settings: Any) -> Any:
    algorithm = make(name, 2, **{"n_updates": 8, "extraction_share": 0.5, **settings})
    for _ in range(n_made):
        algorithm.update(random_batch(2))
    return algorithm


@pytest.mark.parametrize(
    ("name", "extraction", "is_frozen"), once_each(tuple(KINDS), SECOND, (True, False))
)
def test_what_moves_in_the_second_stage(name: str, extraction: str, is_frozen: bool) -> None:
    algorithm = in_two_stages(name, 4, extraction=extraction, frozen_critics=is_frozen)
    before = state(algorithm)
    losses = algorithm.update(random_batch(2))
    found = moved(before, algorithm.state_dict())
    assert {"extraction_loss", "extracted_q"} <= set(losses)
    assert ("critic_loss" in losses) != is_frozen
    assert "actor" in found
    assert any("critic" in k or "utilit" in k for k in found) != is_frozen
    assert not any("density" in k for k in found)


@by_robot
def test_nobody_climbs_the_values_of_who_has_left(name: str) -> None:
    """Critics do not learn these, and what such a robot sees moved the others' actions."""
    alive = torch.tensor([True, False]).expand(2, 32, 2)
    gone = {"alive": alive, "next_alive": alive, "agent_terminations": torch.zeros_like(alive)}
    batch, actors = replace(random_batch(2), **gone), []
    seen = batch.observations + torch.tensor([0.0, 1.0])[:, None]
    for each in (batch, replace(batch, observations=seen)):
        algorithm = in_two_stages(name, 4, extraction="anchored", joint_gradient="all")
        losses = algorithm.update(each)
        actors.append((algorithm.actor.online.network.flat, losses["extracted_q"]))
    torch.testing.assert_close(actors[0], actors[1])


@pytest.mark.parametrize("name", ["cfcql", "facmac_bc", "omar"])  # critics of three kinds
def test_values_climb_in_the_second_stage(name: str) -> None:
    algorithm = in_two_stages(
        name, 21, n_updates=40, extraction="anchored", inverse_temperature=50.0,
        actor_learning_rate=1e-2, slope_limit=1e3, frozen_critics=True,
    )  # fmt: skip
    first = algorithm.update(random_batch(2))["extracted_q"]
    for _ in range(15):
        last = algorithm.update(random_batch(2))["extracted_q"]
    assert (last > first).all()


def test_weighted_extraction_clones_the_better_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    algorithm = in_two_stages(
        "maddpg_bc", 4, extraction="weighted", effective_share=0.01, inverse_temperature=1e6
    )
    batch, values = random_batch(2), torch.full((2, 32, 2), -1.0)
    values[:, 5] = 0.0  # of the data's actions, as those of the density are

    def of_candidates(candidates: Tensor) -> Tensor:
        n = candidates.shape[3]
        return values[..., None] if n == 1 else torch.zeros(2, 32, 2, n)

    monkeypatch.setattr(algorithm, "valuer", lambda *_: Valuer(lambda pi: pi, of_candidates))
    errors = (algorithm.actor(batch.observations) - batch.actions).square().sum(3)[:, 5]
    losses = algorithm.update(batch)
    torch.testing.assert_close(losses["extraction_loss"], errors.mean(1).detach())


@pytest.mark.parametrize("extraction", SECOND)
def test_the_second_stage_goes_on_where_it_stopped(extraction: str) -> None:
    whole, broken = (in_two_stages("maddpg_bc", n, extraction=extraction) for n in (8, 6))
    again = in_two_stages("maddpg_bc", 0, extraction=extraction)
    again.load_state_dict(broken.state_dict())
    for _ in range(2):
        again.update(random_batch(2))
    assert not moved(whole.state_dict(), again.state_dict())


def test_each_stage_has_a_cosine_of_its_own() -> None:
    algorithm = make("maddpg_bc", n_updates=100, extraction="anchored", extraction_share=0.4)
    scales = []
    for algorithm.n_updates in (0, 30, 59, 60, 80, 99):
        scales.append(algorithm.scale)
    assert scales[::3] == [1.0, 1.0]
    assert scales[1::3] == pytest.approx([0.5, 0.5])
    assert max(scales[2::3]) < 0.01
