"""Rows drawn by weight: the temperature keeps its floor, draws are in proportion and repeatable."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.memory.segments import each_field, learned_rows, learned_steps
from swarmdata.learn.networks.network_inputs import generators
from swarmdata.learn.objectives.weighted_rows import (
    ABSENT,
    ScoredRows,
    draw,
    effective_share_of,
    row_weights,
)
from swarmdata.types import Batch
from tests.offline_algos.toys import random_batch


def shares(advantages: Tensor, beta: Tensor) -> Tensor:
    logs = (beta[:, None, None] * advantages).double()
    return effective_share_of(logs.exp().clamp(max=100.0)).float()


def test_the_effective_share_by_hand() -> None:
    """Of n rows, k of weight 1 and the others of 0 are k / n effective ones."""
    weights = torch.tensor([[[1.0], [1.0], [0.0], [0.0]], [[3.0], [3.0], [3.0], [3.0]]])
    assert effective_share_of(weights).tolist() == [0.5, 1.0]


@settings(deadline=None, max_examples=25)
@given(
    st.sampled_from(["normal", "skewed", "two values"]),
    st.floats(0.15, 0.9),
    st.sampled_from([1e-3, 1.0, 1e3]),
)
def test_beta_is_the_largest_that_keeps_the_floor(kind: str, share: float, unit: float) -> None:
    noise = torch.randn(2, 300, 3, generator=torch.Generator().manual_seed(0))
    kinds = {"normal": noise, "skewed": noise.exp(), "two values": (noise > 1).float()}
    advantages = unit * kinds[kind]
    largest = 30.0 / unit
    weights, beta = row_weights(advantages, largest, share)
    found = effective_share_of(weights)
    torch.testing.assert_close(found, shares(advantages, beta), rtol=1e-3, atol=0)
    assert (found >= share).all()
    assert ((beta == largest) | (shares(advantages, 1.05 * beta) < share)).all()


def test_beta_is_a_setting_at_most_and_each_seed_has_its_own() -> None:
    noise = torch.randn(2, 500, 2, generator=torch.Generator().manual_seed(1))
    advantages = noise * torch.tensor([0.1, 10.0])[:, None, None]
    _, beta = row_weights(advantages, 2.0, 0.6)
    assert beta[0] == 2.0
    assert beta[1] < 0.2
    rare = torch.where(noise > -2.5, 0.01 * noise, -100.0)  # as collisions are
    _, beta = row_weights(rare, 20.0, 0.4)
    assert (beta == 20.0).all()
    _, beta = row_weights(advantages, torch.tensor([0.5, 0.01]), 0.6)
    torch.testing.assert_close(beta, torch.tensor([0.5, 0.01]))
    weights, _ = row_weights(advantages, 0.0, 0.4)
    assert (weights == 1).all()


@pytest.mark.parametrize("values", [0.0, -1e29])
def test_equal_advantages_weigh_alike(values: float) -> None:
    weights, _ = row_weights(torch.full((1, 5, 2), values), 3.0, 0.5)
    assert (weights == 1).all()


def test_rows_are_drawn_as_often_as_their_weight_says() -> None:
    """Systematic draws: 0 and 8 of 16, the others 4; each robot by its own weights."""
    weights = torch.tensor([[0.0, 2.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0]])[None]
    rows = draw(weights, 16, generators([7], "cpu"))
    counts = [torch.bincount(rows[0, :, i], minlength=4).tolist() for i in (0, 1)]
    assert counts == [[0, 4, 4, 8], [8, 0, 4, 4]]


def test_what_is_left_of_a_row_is_drawn_by_chance() -> None:
    weights = torch.tensor([0.9, 0.1]).view(1, 2, 1)
    source = generators([3], "cpu")
    second = sum(int(draw(weights, 1, source).item()) for _ in range(2000))
    assert 150 < second < 250


def numbered(first: int, n_rows: int = 4, n_agents: int = 2) -> Batch:
    """A batch whose observations and actions are the numbers of its rows, from `first` on."""
    numbers = torch.arange(first, first + n_rows, dtype=torch.float32)
    values = numbers.view(1, -1, 1, 1).expand(1, -1, n_agents, 3)
    return each_field(random_batch(size=n_rows), lambda each: values if each.ndim == 4 else each)


def seen(batch: Batch) -> tuple[Batch, Tensor]:
    """Stands for an actor that answers with what it observes."""
    return batch, batch.observations


def test_rows_come_from_the_last_batches_that_hold_one_of_effective_rows() -> None:
    rows = ScoredRows(0.4, generators([0], "cpu"))  # three batches
    for n in range(5):
        rows.add(numbered(4 * n), torch.zeros(1, 4, 2))
        drawn = [rows.draw(seen, 1.0)[0] for _ in range(30)]
        assert all(actions.shape == (1, 4, 2, 3) for actions in drawn)
        numbers = set(torch.cat(drawn).flatten().int().tolist())
        assert numbers == set(range(4 * max(0, n - 2), 4 * n + 4))


def test_rows_of_robots_that_have_left_are_not_drawn_and_do_not_count() -> None:
    advantages = torch.tensor([[[9.0, 0.0], [1.0, 0.0], [9.0, 1.0], [2.0, 0.0]]])
    alive = torch.tensor([[[False, True], [True, True], [False, True], [True, True]]])
    rows, shares = ScoredRows(1.0, generators([0], "cpu")), []
    rows.add(numbered(10), advantages, alive)
    for _ in range(20):
        actions, _, beta = rows.draw(seen, 1e3)
        assert set(actions[:, :, 0].flatten().int().tolist()) <= {11, 13}
        shares.append(beta)
    assert max(shares) < 1e-2  # all rows but two are to count alike
    nobody = torch.zeros(1, 4, 2, dtype=torch.bool)
    rows.add(numbered(20), advantages, nobody)
    assert torch.isfinite(rows.draw(seen, 1.0)[0]).all()


def test_actions_and_outputs_are_of_the_same_rows_and_of_each_robot_s_own() -> None:
    rows = ScoredRows(0.1, generators([0], "cpu"))
    advantages = torch.full((1, 4, 2), -1e3)
    advantages[0, 1, 0] = advantages[0, 3, 1] = 0.0
    rows.add(numbered(10), advantages)
    actions, outputs, _ = rows.draw(seen, 1e6)
    assert (actions[:, :, 0] == 11).all()
    assert (actions[:, :, 1] == 13).all()
    assert torch.equal(actions, outputs)


def windows(n_windows: int = 3, length: int = 6) -> Batch:
    """Windows [1, B, L, ...] in which row 10 w + t of both robots has these numbers."""
    numbers = 10 * torch.arange(n_windows)[:, None] + torch.arange(length)
    values = numbers.float()[None, :, :, None, None].expand(1, -1, -1, 2, 3)
    nothing = dict.fromkeys(
        ("rewards", "next_observations", "states", "next_states", "terminations", "truncations")
    )
    mask = torch.ones(1, n_windows, length, dtype=torch.bool)
    return Batch(observations=values, actions=values, mask=mask, **nothing)


@pytest.mark.slow
def test_steps_of_windows_count_by_their_weight() -> None:
    """Segments of two steps after a burn-in of four: each step is drawn as its weight says."""

    def along(batch: Batch) -> tuple[Batch, Tensor]:
        steps = learned_steps(batch, learned_rows(batch.mask, 2))
        return steps, steps.observations

    rows = ScoredRows(1e-3, generators([0], "cpu"))
    advantages = torch.tensor([[0, 1], [0, 1], [0, 1], [0, 1], [1, 0], [1, 0]]).float()
    rows.add(windows(), advantages[None])
    drawn, n_draws = [], 1500
    for _ in range(n_draws):
        actions, outputs, _ = rows.draw(along, 1.0)
        assert actions.shape == (1, 6, 2, 3)
        assert torch.equal(actions, outputs)
        drawn.append(actions[0, ..., 0])
    counts = [torch.bincount(each.int()) for each in torch.cat(drawn).T]
    expected = advantages.softmax(0)  # [6, N], of steps 4, 5, 14, 15, 24, 25
    for i in (0, 1):
        found = counts[i][[4, 5, 14, 15, 24, 25]] / (6 * n_draws)
        torch.testing.assert_close(found, expected[:, i], rtol=0.1, atol=0)
        assert found.sum() == pytest.approx(1)


@pytest.mark.parametrize("share", [0.0, -0.5, 1.5, float("nan")])
def test_a_share_of_no_or_of_more_than_all_rows_is_refused(share: float) -> None:
    with pytest.raises(SchemaError, match="effective_share"):
        ScoredRows(share, generators([0], "cpu"))


@pytest.mark.parametrize("beta", [0.0, 3.0])
def test_rows_of_robots_that_left_have_no_weight(beta: float) -> None:
    """Not even where all others have the same."""
    weights, _ = row_weights(torch.tensor([[[0.3, ABSENT], [0.1, ABSENT]]]), beta, 0.5)
    assert (weights > 0).tolist() == [[[True, False], [True, False]]]
