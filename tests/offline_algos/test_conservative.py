"""What MADDPG+CQL, CFCQL and ICQL-QS have in common: targets, penalties, and learning."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from torch import Tensor  # noqa: E402

from swarmdata.learn.networks.robot_views import RobotView  # noqa: E402
from swarmdata.offline_algos.cfcql import CFCQL  # noqa: E402
from swarmdata.offline_algos.icql_qs import ICQLQS  # noqa: E402
from swarmdata.offline_algos.maddpg_cql import MADDPGCQL  # noqa: E402
from swarmdata.testing.memory_dataset import MemoryDataset  # noqa: E402
from tests.offline_algos.toys import (  # noqa: E402
    made,
    progress_of,
    random_batch,
    set_bias,
    trained,
    two_episodes,
)

KINDS: Any = (MADDPGCQL, CFCQL, ICQLQS)
each = pytest.mark.parametrize("kind", KINDS)


@each
def test_targets_of_two_episodes_are_exact(kind: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """V(s) = 100 episode + 10 time: a bootstrap across an end would be off by 60 or more."""
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()

    def value(view: RobotView, *actions: Tensor) -> Tensor:
        states = view.features[..., 3 + 2 :]  # after the observation and the robot's number
        v = 100 * states[..., 0] + 10 * states[..., 1]  # [K, B, N]
        return torch.stack([v, v + 1], 1)  # the smaller twin counts

    # episode 1: r + V(1, 1) / 2, then r without a bootstrap; episode 2: the cut does not stop it
    own = [[1 + 55.0, 3 + 55.0], [5.0, 7.0], [1 + 105.0, 3 + 105.0], [5 + 110.0, 7 + 110.0]]
    team = [[2 + 55.0] * 2, [6.0] * 2, [2 + 105.0] * 2, [6 + 110.0] * 2]
    for reward, expected in (("own", own), ("team", team)):
        algorithm = made(kind, discount=0.5, reward=reward)
        monkeypatch.setattr(algorithm.critics, "target_q", value)
        torch.testing.assert_close(algorithm.targets(batch), torch.tensor([expected]))


@each
def test_targets_have_the_reward_scale_and_the_bound(kind: Any) -> None:
    batch = random_batch()
    changes = {"own_return_std": 2.0, "own_max_return": 3.0}
    for clip, worth in ((True, 1.5), (False, 5.0)):  # R* / scale is 1.5
        algorithm = made(kind, changes=changes, discount=0.9, clip_target=clip)
        for row in (0, 1):
            set_bias(algorithm.critics.target, row, 5.0 + row)
        expected = batch.rewards / 2 + 0.9 * worth * ~batch.terminations[..., None]
        torch.testing.assert_close(algorithm.targets(batch), expected)


@each
def test_each_critic_is_penalized_for_its_own_values(kind: Any) -> None:
    """og-marl's second critic was penalized for the first one's samples."""
    algorithm, batch = made(kind), random_batch()
    x = algorithm.critic_inputs(batch)
    for critic in range(2):
        gap = algorithm.gap(batch, x, algorithm.critics.q(x, batch.actions))
        assert gap.shape == (1, 2)
        algorithm.critics.online.backward(gap[0, critic])
        moved = algorithm.critics.online.gradient.abs().sum(1)
        assert moved[critic] > 0
        assert moved[1 - critic] == 0


@each
def test_twins_begin_apart_and_both_learn(kind: Any) -> None:
    algorithm = made(kind, 2)
    critics = algorithm.critics.online
    before = critics.flat.clone()
    assert not torch.equal(before[0], before[1])
    algorithm.update(random_batch(2))
    assert critics.gradient.norm(dim=1).min() > 0
    assert not torch.equal(*critics.gradient[:2])
    assert (critics.flat - before).abs().amax(1).min() > 0


@each
@pytest.mark.parametrize("joint_gradient", ["all", "own"])
def test_the_actors_step_leaves_the_critics_alone(kind: Any, joint_gradient: str) -> None:
    algorithm, batch = made(kind, joint_gradient=joint_gradient), random_batch()
    algorithm.update(batch)
    critics, actor = algorithm.critics.online, algorithm.actor.online.network
    parameters, gradient, old = critics.flat.clone(), critics.gradient.clone(), actor.flat.clone()
    pi = algorithm.actor(batch.observations)
    loss = algorithm.actor_loss(batch, algorithm.critic_inputs(batch), pi, torch.zeros(1))
    algorithm.actor.step(loss.total)
    assert torch.equal(critics.flat, parameters)
    assert torch.equal(critics.gradient, gradient)
    assert not torch.equal(actor.flat, old)


@each
def test_the_penalty_does_not_move_the_actors(kind: Any) -> None:
    algorithm, batch = made(kind, policy_delay=2), random_batch()
    actor = algorithm.actor.online.network.flat.clone()
    losses = algorithm.update(batch)
    assert set(losses) == {"critic_loss", "gap", "q"}
    assert torch.equal(algorithm.actor.online.network.flat, actor)


@each
def test_the_penalty_prefers_the_data(kind: Any) -> None:
    """Rewards do not depend on actions: only the penalty can tell the data's from others."""
    g = torch.Generator().manual_seed(0)
    batch = random_batch(1, 64)
    batch.actions[...] = 0.5 + 0.05 * torch.randn(batch.actions.shape, generator=g)
    batch.rewards[...] = 0.0
    batch.terminations[...] = True

    def preference(cql_weight: float) -> float:
        settings: dict[str, Any] = {"critic_learning_rate": 1e-2, "bc_warmup_updates": 1000}
        algorithm = made(kind, cql_weight=cql_weight, **settings)
        for _ in range(60):
            algorithm.update(batch)
        x = algorithm.critic_inputs(batch)
        data, opposite = (algorithm.critics.q(x, a).mean() for a in (batch.actions, -batch.actions))
        return (data - opposite).item()

    assert preference(1.0) > preference(0.0) + 0.1


@each
def test_a_row_is_not_penalized_beyond_its_limit(kind: Any) -> None:
    """Where the data's action is worth much more than all others, the penalty has no gradient."""
    batch, steep = random_batch(1, 64), {}
    for limit in (1.0, 1e9):
        algorithm = made(kind, gap_limit=limit)
        x = algorithm.critic_inputs(batch)
        q = algorithm.critics.q(x, batch.actions) + 50.0  # far above any sample
        gap = algorithm.gap(batch, x, q)
        algorithm.critics.online.backward(gap.sum())
        steep[limit] = algorithm.critics.online.gradient.abs().max().item()
    assert steep[1.0] == 0.0
    assert steep[1e9] > 0.0


@each
def test_the_pull_of_values_does_not_depend_on_the_size_of_the_team(kind: Any) -> None:
    """Independent robots are added: the gradient in one robot's action is that of its own value."""
    gradients = []
    for n_agents in (1, 4):
        observations, actions = torch.ones(1, 8, n_agents, 3), torch.zeros(1, 8, n_agents, 2)
        pi = torch.zeros(1, 8, n_agents, 2, requires_grad=True)
        algorithm = made(kind)
        batch = replace(random_batch(1, 8), observations=observations, actions=actions)

        def own(view: Any, mine: Tensor, others: Tensor) -> Tensor:
            return mine.sum(-1)  # [K, B, N]

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(algorithm.critics, "first_q", own)
            bc_loss = algorithm.bc_loss(pi, actions + 0.5)
            loss = algorithm.actor_loss(batch, None, pi, bc_loss)
        (gradient,) = torch.autograd.grad(loss.total.sum(), [pi])
        gradients.append(n_agents * gradient[0, 0, 0])  # of a sum over robots
    torch.testing.assert_close(*gradients)


@each
def test_the_warmup_clones_and_then_the_delay_counts(kind: Any) -> None:
    algorithm, batch = made(kind, bc_warmup_updates=2, policy_delay=2), random_batch()
    keys = [set(algorithm.update(batch)) - {"critic_loss", "gap", "q"} for _ in range(4)]
    assert keys == [{"bc_loss"}, {"bc_loss"}, set(), {"bc_loss", "policy_q"}]


@each
def test_a_weight_on_imitation_holds_the_policy(kind: Any) -> None:
    distances = []
    for weight in (0.0, 100.0):
        algorithm, batch = (
            made(kind, bc_weight=weight, bc_warmup_updates=10, actor_learning_rate=1e-2),
            random_batch(),
        )
        for _ in range(40):
            losses = algorithm.update(batch)
        distances.append(losses["bc_loss"].item())
    assert distances[1] < distances[0]


@pytest.mark.learns
@each
def test_it_beats_its_data(kind: Any, mixture: MemoryDataset) -> None:
    """Half of the data drive at the goal, the other half at random; no imitation after the start.

    Progress of a step: 0 for the data, 0.045 for a clone of them, 0.16 for driving straight.
    """
    algorithm, _ = trained(
        kind,
        mixture,
        800,
        critic_learning_rate=1e-3,
        bc_warmup_updates=200,
        n_samples=4,
        bc_weight=0.0,  # the papers'
    )
    observations = mixture.transitions["observations"]
    for index in range(2):
        learned = progress_of(algorithm.policy(index).actions(observations), observations)
        assert learned > 0.08
