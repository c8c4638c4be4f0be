"""What MADDPG+CQL, CFCQL and ICQL-QS have in common: targets, penalties, and learning."""

from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from torch import Tensor  # noqa: E402

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
    algorithm = made(kind, discount=0.5)

    def value(x: Tensor, actions: Tensor) -> Tensor:
        v = 100 * x[..., :1] + 10 * x[..., 1:2]
        return torch.stack([v, v + 1], 1)  # the smaller twin counts

    monkeypatch.setattr(algorithm.critics, "target_q", value)
    batch = two_episodes().sampler().gather(np.arange(4)[None]).to_torch()
    y = algorithm.targets(batch)
    # episode 1: 2 + V(1, 1) / 2, then 6 without a bootstrap; episode 2: the cut does not stop it
    torch.testing.assert_close(y, torch.tensor([[2 + 55.0, 6.0, 2 + 105.0, 6 + 110.0]]))


@each
def test_targets_have_the_reward_scale_and_the_bound(kind: Any) -> None:
    batch = random_batch()
    team = batch.rewards.mean(-1)
    for clip, worth in ((True, 1.5), (False, 5.0)):  # R* / scale is 1.5
        algorithm = made(
            kind, changes={"return_std": 2.0, "max_return": 3.0}, discount=0.9, clip_target=clip
        )
        for row in (0, 1):
            set_bias(algorithm.critics.target, row, 5.0 + row)
        expected = team / 2 + 0.9 * worth * ~batch.terminations
        torch.testing.assert_close(algorithm.targets(batch), expected)


@each
def test_each_critic_is_penalized_for_its_own_values(kind: Any) -> None:
    """og-marl's second critic was penalized for the first one's samples."""
    algorithm, batch = made(kind), random_batch()
    x = algorithm.normalizer.information(batch.states, batch.observations)
    for critic in range(2):
        gap = algorithm.gap(batch, x, algorithm.critics.q(x, batch.actions)[..., 0])
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
        x = algorithm.normalizer.information(batch.states, batch.observations)
        data, opposite = (algorithm.critics.q(x, a).mean() for a in (batch.actions, -batch.actions))
        return (data - opposite).item()

    assert preference(1.0) > preference(0.0) + 0.1


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
