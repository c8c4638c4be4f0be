"""Value decomposition: double Q targets, gradients of both networks, discrete games."""

from dataclasses import replace
from typing import Any

import pytest

torch = pytest.importorskip("torch", reason="the toolbox needs torch")

from torch import Tensor  # noqa: E402

from swarmdata.learn.choices import bins  # noqa: E402
from swarmdata.learn.networks.network_inputs import information  # noqa: E402
from swarmdata.learn.networks.sizes import Sizes  # noqa: E402
from swarmdata.online_algos.qmix import QMIXConfig, QMIXLearner  # noqa: E402
from swarmdata.online_algos.vdn import VDNConfig, VDNLearner  # noqa: E402
from swarmdata.types import Batch  # noqa: E402
from tests.offline_algos.toys import seed_of  # noqa: E402

N_AGENTS, N_BINS, N_DIMENSIONS = 2, 3, 2
SETTINGS: dict[str, Any] = {
    "n_bins": N_BINS,
    "hidden": (16,),
    "discount": 0.5,
    "reward_scale": 2.0,
    "learning_rate": 1e-2,
    "tau": 0.25,
    "max_grad_norm": None,
}


def made(
    kind: str = "mean",
    n_seeds: int = 2,
    *,
    n_dimensions: int = N_DIMENSIONS,
    n_inputs: int = 5,
    **changes: Any,
) -> VDNLearner | QMIXLearner:
    sizes = Sizes(N_AGENTS, n_inputs, n_dimensions, 4)
    settings = {**SETTINGS, **changes}
    if kind == "mean":
        return VDNLearner(sizes, range(n_seeds), VDNConfig(**settings))
    mixing = QMIXConfig(**settings, mixer_embedding=8, mixer_hidden=8)
    return QMIXLearner(sizes, range(n_seeds), mixing)


def random_batch(n_seeds: int = 2, size: int = 12) -> Batch:
    g = torch.Generator().manual_seed(0)
    shape = (n_seeds, size)
    flags = torch.rand(shape, generator=g) < 0.3
    choices = torch.randint(N_BINS, (*shape, N_AGENTS, N_DIMENSIONS), generator=g)
    return Batch(
        observations=torch.randn(*shape, N_AGENTS, 5, generator=g),
        actions=choices.float(),
        rewards=torch.randn(*shape, N_AGENTS, generator=g),
        next_observations=torch.randn(*shape, N_AGENTS, 5, generator=g),
        states=torch.randn(*shape, 4, generator=g),
        next_states=torch.randn(*shape, 4, generator=g),
        terminations=flags,
        truncations=~flags,
        mask=torch.ones_like(flags),
        next_actions=choices.float().flip(1),
        log_probs=torch.zeros(*shape, N_AGENTS),
    )


@pytest.mark.parametrize("kind", ["mean", "monotonic"])
def test_the_online_networks_choose_and_the_targets_value(kind: str) -> None:
    learner, batch = made(kind), random_batch()
    learner.descent.targets["team"].flat.normal_(generator=torch.Generator().manual_seed(1))
    y = learner.targets(batch)
    k, b = 1, 7
    seen = batch.next_observations[k : k + 1, b : b + 1]
    both = seen.expand(2, -1, -1, -1)
    online = learner.utilities(both)[k, 0, 0]  # [N, D, C]
    target = learner.utilities(both, learner.descent.targets["team"])[k, 0, 0]
    values = []
    for robot in range(N_AGENTS):
        picked = [target[robot, d, int(online[robot, d].argmax())] for d in range(N_DIMENSIONS)]
        values.append(torch.stack(picked).mean())
    q = torch.stack(values)[None, None].expand(2, 1, -1)
    x_next = information(batch.next_states[:, b : b + 1], batch.next_observations[:, b : b + 1])
    if isinstance(learner, QMIXLearner):
        mixed = learner.mixer(q, x_next, learner.descent.targets["mixer"])[k, 0]
    else:
        mixed = q.mean(-1)[k, 0]
    alive = 0.0 if batch.terminations[k, b] else 1.0
    expected = 2.0 * batch.rewards[k, b].mean() + 0.5 * alive * mixed
    torch.testing.assert_close(y[k, b], expected)


@pytest.mark.parametrize("kind", ["mean", "monotonic"])
def test_a_step_moves_everything_towards_the_targets(kind: str) -> None:
    learner, batch = made(kind), random_batch()
    frozen = learner.targets(batch)

    def error() -> Tensor:
        q = learner.value(batch.observations, batch.states, batch.actions.long())[:, 0]
        return (q - frozen).abs().mean(1).detach()

    before, networks = error(), learner.descent.networks
    old = {name: network.flat.clone() for name, network in networks.items()}
    for _ in range(20):
        learner.update(batch)
    assert (error() < before).all()
    for name, network in networks.items():
        assert not torch.equal(network.flat, old[name]), name


def test_targets_follow_by_tau() -> None:
    learner, batch = made("monotonic"), random_batch()
    old = [target.flat.clone() for target in learner.descent.targets.values()]
    learner.update(batch)
    for start, target, network in zip(
        old, learner.descent.targets.values(), learner.descent.networks.values(), strict=True
    ):
        torch.testing.assert_close(target.flat, start + 0.25 * (network.flat - start))


def test_truncation_bootstraps_and_termination_does_not() -> None:
    learner, batch = made(), random_batch()
    flags = torch.zeros_like(batch.terminations)
    cut = replace(batch, terminations=flags, truncations=~flags)
    on = replace(batch, terminations=flags, truncations=flags)
    over = replace(batch, terminations=~flags, truncations=flags)
    assert torch.equal(learner.targets(cut), learner.targets(on))
    torch.testing.assert_close(learner.targets(over), 2.0 * batch.rewards.mean(-1))
    assert not torch.allclose(learner.targets(over), learner.targets(cut))


@pytest.mark.parametrize("kind", ["mean", "monotonic"])
def test_a_seed_of_a_stack_learns_what_it_learns_alone(kind: str) -> None:
    stack, batch = made(kind, 2), random_batch(2)
    alone = made(kind, 1)  # seed 0
    first = seed_of(batch, 0)
    for _ in range(20):
        stack.update(batch)
        alone.update(first)
    for ours, theirs in zip(
        stack.descent.networks.values(), alone.descent.networks.values(), strict=True
    ):  # fmt: skip
        torch.testing.assert_close(ours.flat[:1], theirs.flat, rtol=0, atol=2e-5)


def test_a_state_restores_everything() -> None:
    ours, batch = made("monotonic"), random_batch()
    for _ in range(3):
        ours.update(batch)
    saved = ours.descent.state_dict()
    other = made("monotonic")
    other.descent.load_state_dict(saved)
    for learner in (ours, other):
        learner.update(batch)
    for name, value in ours.descent.state_dict().items():
        assert torch.equal(value, other.descent.state_dict()[name]), name


def play(payoff: Tensor, kind: str) -> tuple[Tensor, Tensor]:
    """Trains on every cell of a two-robot matrix game; returns Q_tot [C, C] and greedy choices.

    A discrete action space is one dimension of choices; the game ends after one step.
    """
    rates = {"discount": 0.9, "reward_scale": 1.0, "tau": 0.1}
    learner = made(kind, 1, n_dimensions=1, n_inputs=1, **rates)
    cells = torch.cartesian_prod(torch.arange(3), torch.arange(3))[None]  # [1, 9, 2]
    ones = torch.ones(1, 9, dtype=torch.bool)
    batch = Batch(
        observations=torch.ones(1, 9, 2, 1),
        actions=cells[..., None].float(),
        rewards=payoff[cells[..., 0], cells[..., 1]][..., None].expand(-1, -1, 2),
        next_observations=torch.ones(1, 9, 2, 1),
        states=torch.ones(1, 9, 4),
        next_states=torch.ones(1, 9, 4),
        terminations=ones,
        truncations=~ones,
        mask=ones,
    )
    for _ in range(800):
        learner.update(batch)
    q = learner.value(batch.observations, batch.states, cells[..., None]).detach().view(3, 3)
    return q, bins.greedy(learner.utilities(batch.observations))[0, 0, 0, :, 0]


def test_a_sum_of_values_is_found_by_both() -> None:
    payoff = torch.tensor([0.0, 1.0, 3.0])[:, None] + torch.tensor([2.0, 0.0, 1.0])
    for kind in ("mean", "monotonic"):
        q, choices = play(payoff, kind)
        torch.testing.assert_close(q, payoff, rtol=0, atol=0.1)
        assert choices.tolist() == [2, 0]


def test_a_monotonic_game_is_one_that_only_qmix_can_write_down() -> None:
    """Both must do their part for the reward: monotonic in each robot's choice, and no sum."""
    payoff = torch.tensor([[0.0, 0.0, 0.0], [0.0, 1.0, 2.0], [0.0, 2.0, 8.0]])
    q, choices = play(payoff, "monotonic")
    torch.testing.assert_close(q, payoff, rtol=0, atol=0.3)
    assert choices.tolist() == [2, 2]
    additive, _ = play(payoff, "mean")
    assert (additive - payoff).abs().max() > 1.0
