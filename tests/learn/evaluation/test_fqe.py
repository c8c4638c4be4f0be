"""Fitted Q evaluation finds values that are known, and keeps its promises."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from swarmdata.errors import DivergedError, SchemaError
from swarmdata.learn.evaluation.fqe import (
    BATCH_SIZE,
    Answered,
    FittedQ,
    FQEConfig,
    Values,
    attainable,
    draws,
    fitted_q_evaluation,
    imitation_error,
    td_errors,
    weighted_imitation_error,
)
from swarmdata.learn.evaluation.transitions import Transitions
from swarmdata.learn.networks.critics import Critics
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.network_inputs import Reward
from swarmdata.learn.networks.setup import Setup, Sizes
from swarmdata.offline_algos.maddpg_bc import MADDPGBC, MADDPGBCConfig
from swarmdata.types import Batch
from tests.learn.chain import N_AGENTS, Constant, chain
from tests.support.memory_dataset import MemoryDataset

ACTIONS = (0.5, -0.5)
SMALL: dict[str, Any] = {"hidden": (32,), "batch_size": 64, "discount": 0.5, "learning_rate": 1e-2}


def asked(
    dataset: MemoryDataset, actions: tuple[float, ...] = ACTIONS, discount: float = 0.5
) -> Answered:
    statistics = Statistics.measure(dataset, discount)
    data = Transitions.read(dataset, statistics, discount)
    return Answered.by([Constant(action) for action in actions], dataset, data)


def fit(dataset: MemoryDataset, actions: tuple[float, ...] = ACTIONS, **changes: Any) -> Values:
    config = FQEConfig(**{**SMALL, "n_updates": 300, **changes})
    split = asked(dataset, actions, config.discount)
    return fitted_q_evaluation(split, split, 1.0, config, progress=False)


def test_values_of_a_task_that_goes_on() -> None:
    """V(0) = a + g 2 a + g^2 V(0), though every recorded episode is cut after three steps."""
    made = fit(chain(100, ends=False))
    from_0 = np.array(ACTIONS) * (1 + 2 * 0.5) / (1 - 0.25)
    from_1 = np.array(ACTIONS) * (2 + 0.5) / (1 - 0.25)
    assert made.values.shape == (2, 1, 100)
    np.testing.assert_allclose(made.values[:, 0, ::2].mean(1), from_0, rtol=0.05)
    np.testing.assert_allclose(made.values[:, 0, 1::2].mean(1), from_1, rtol=0.05)
    np.testing.assert_allclose(made.mean, (from_0 + from_1) / 2, rtol=0.05)
    assert made.residual.max() < 0.1
    assert made.clipped.max() < 0.05


def cut_early(n_episodes: int) -> MemoryDataset:
    """`chain`, but a robot is cut before its team."""
    alive = np.array([[True, True], [True, True], [True, False], [False, False]])
    cuts, seen = alive[:-1] & ~alive[1:], alive.copy()
    seen[1:] |= cuts
    return MemoryDataset([
        replace(
            each, alive=alive, agent_terminations=np.zeros_like(cuts), agent_truncations=cuts,
            observations=each.observations * seen[..., None], rewards=each.rewards * alive[:-1],
            actions=each.actions * alive[:-1, :, None],
        )
        for each in chain(n_episodes, ends=False)
    ])  # fmt: skip


def test_a_robot_that_is_cut_has_no_end() -> None:
    """The values are those of `test_values_of_a_task_that_goes_on`, though one robot is cut."""
    dataset = cut_early(100)
    from_0 = np.array(ACTIONS) * (1 + 2 * 0.5) / (1 - 0.25)
    made = fit(dataset)
    np.testing.assert_allclose(made.values[:, 0, ::2].mean(1), from_0, rtol=0.05)
    assert made.residual.max() < 0.1


@pytest.mark.slow
def test_values_of_a_task_that_ends() -> None:
    """V(0) = a + g 2 a: nothing comes after a termination."""
    made = fit(chain(100, ends=True))
    np.testing.assert_allclose(made.mean, np.array(ACTIONS) * 2.0, rtol=0.05)


def test_a_policy_of_a_stack_gets_the_value_that_it_gets_alone() -> None:
    dataset = chain(20, ends=False)
    changes: dict[str, Any] = {"n_updates": 60, "n_fits": 2}
    stack = fit(dataset, **changes)
    assert not np.allclose(stack.values[:, 0], stack.values[:, 1])
    for k, action in enumerate(ACTIONS):
        alone = fit(dataset, (action,), **changes)
        np.testing.assert_allclose(stack.values[k], alone.values[0], atol=1e-4)
        np.testing.assert_allclose(stack.residual[k], alone.residual[0], atol=1e-4)


def test_the_curve_ends_at_the_values() -> None:
    made = fit(chain(20, ends=False), n_updates=25)
    assert made.curve.shape == (10, 2, 1)
    np.testing.assert_allclose(made.curve[-1], made.values.mean(2), atol=1e-9)
    assert fit(chain(20, ends=False), n_updates=3).curve.shape == (3, 2, 1)


def set_values(monkeypatch: pytest.MonkeyPatch, factor: float) -> None:
    """Makes every critic say factor * (state + 10 * the first robot's action)."""

    def say(self: Critics, x: Tensor, actions: Tensor) -> Tensor:
        return (factor * (x[..., 0] + 10 * actions[..., 0, 0]))[:, None, :, None]

    monkeypatch.setattr(Critics, "target_q", say)


def test_targets_are_exact_and_do_not_cross_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = chain(2, ends=False)
    split = asked(dataset)
    fitted = FittedQ(split, 2.0, FQEConfig(**SMALL))
    monkeypatch.setattr(fitted, "bound", (-1e9, 1e9))
    set_values(monkeypatch, 1.0)
    y, clipped = fitted.targets(split, torch.arange(6))
    rewards = dataset.transitions["rewards"].mean(1) / 2
    reached = dataset.transitions["next_states"][:, 0]
    normal = (reached - 0.5) / 0.5  # both states are seen equally often
    for k, action in enumerate(ACTIONS):
        expected = rewards + 0.5 * (normal + 10 * action)
        np.testing.assert_allclose(y[k, 0], expected, rtol=1e-5)
    assert clipped.max() == 0


def test_targets_stay_attainable_and_tell_where_they_were_cut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    split = asked(chain(10, ends=False))
    fitted = FittedQ(split, 2.0, FQEConfig(**SMALL))
    set_values(monkeypatch, 1e6)
    index = torch.arange(30)
    y, clipped = fitted.targets(split, index)
    low, high = fitted.bound
    rewards = split.data.rewards
    np.testing.assert_allclose(y[0, 0], rewards / 2 + 0.5 * high / 2, rtol=1e-5)
    np.testing.assert_allclose(y[1, 0], rewards / 2 + 0.5 * low / 2, rtol=1e-5)
    np.testing.assert_array_equal(clipped, 1.0)
    assert float(2 * y.max()) <= high + 1e-5
    assert float(2 * y.min()) >= low - 1e-5


def test_the_attainable_range_is_that_of_the_best_way_to_go_on_or_to_end() -> None:
    going = chain(5, ends=False)
    rewards = going.transitions["rewards"].mean(1)
    low, high = attainable(asked(going).data, 0.9)
    assert (low, high) == pytest.approx((10 * rewards.min(), 10 * rewards.max()))
    ending = chain(5, ends=True)
    rewards = ending.transitions["rewards"].mean(1)
    low, high = attainable(asked(ending).data, 0.0)  # at once
    assert (low, high) == pytest.approx((rewards.min(), rewards.max()))


@given(st.integers(1, 500), st.integers(0, 1 << 20), st.integers(0, 5))
def test_draws_are_rows_and_a_pure_function(n_rows: int, update: int, seed: int) -> None:
    config = FQEConfig(batch_size=32, seed=seed)
    rows = draws(n_rows, config, update)
    assert rows.shape == (32,)
    assert 0 <= rows.min() <= rows.max() < n_rows
    np.testing.assert_array_equal(rows, draws(n_rows, config, update))


def test_draws_are_uniform_and_differ_by_update() -> None:
    config = FQEConfig(batch_size=1000)
    rows = np.concatenate([draws(10, config, update) for update in range(20)])
    assert np.abs(np.bincount(rows, minlength=10) / 2000 - 1).max() < 0.1
    assert not np.array_equal(draws(10, config, 0), draws(10, config, 1))


@pytest.mark.parametrize(
    "changes", [{"n_updates": 0}, {"batch_size": 0}, {"n_fits": 0}, {"discount": 1.0}]
)
def test_settings_out_of_range_are_errors(changes: dict[str, Any]) -> None:
    with pytest.raises(SchemaError, match="discount from 0 to below 1"):
        FQEConfig(**changes)


@pytest.mark.parametrize(
    ("reward", "error", "message"),
    [
        (3e38, SchemaError, r"returns of .* reach .*, expected at most 3\.4e38"),
        (1e38, DivergedError, r"diverged: at update \d+, .* not finite"),
    ],
)
def test_rewards_that_are_far_too_large_are_an_error(
    reward: float, error: type[Exception], message: str
) -> None:
    """Rows 64, 68: with what was too large, or the update."""
    huge = MemoryDataset(
        [
            replace(each, rewards=np.full_like(each.rewards, reward))
            for each in chain(20, ends=False)
        ]
    )
    with pytest.raises(error, match=message):
        fit(huge, n_updates=40)


OTHERS = (0.25, -0.5)


def errors(dataset: MemoryDataset) -> Any:
    """Per policy and transition, mean over robots and components."""
    recorded = dataset.transitions["actions"].astype(np.float64)
    return np.stack([np.square(action - recorded).mean((1, 2)) for action in OTHERS])


def test_the_imitation_error_is_the_loss_of_cloning() -> None:
    dataset = chain(5, ends=True)
    found = imitation_error(asked(dataset, OTHERS))
    np.testing.assert_allclose(found, errors(dataset).mean(1), rtol=1e-5)


def test_the_imitation_error_is_of_robots_that_act() -> None:
    """In the state in which a robot was cut, its answer was compared to an action of 0."""
    dataset = cut_early(5)
    acted = np.concatenate([each.alive[:-1] for each in dataset if each.alive is not None])
    recorded = dataset.transitions["actions"][acted]
    expected = [np.square(action - recorded).mean() for action in OTHERS]
    split = asked(dataset, OTHERS)
    np.testing.assert_allclose(imitation_error(split), expected, rtol=1e-5)
    alike = replace(split, data=replace(split.data, returns=torch.ones_like(split.data.returns)))
    np.testing.assert_allclose(weighted_imitation_error(alike), expected, rtol=1e-5)


def test_what_went_well_weighs_more() -> None:
    """At discount 0 the return-to-go is the reward itself."""
    dataset = chain(5, ends=True)
    rewards = dataset.transitions["rewards"].mean(1, dtype=np.float64)
    weights = np.exp((rewards - rewards.mean()) / rewards.std())
    expected = (errors(dataset) * weights).sum(1) / weights.sum()
    found = weighted_imitation_error(asked(dataset, OTHERS, 0.0))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_equal_returns_weigh_the_same() -> None:
    dataset = chain(4, ends=True)
    for each in dataset:
        each.rewards[:] = 0.0
    split = asked(dataset, OTHERS, 0.9)
    np.testing.assert_allclose(weighted_imitation_error(split), imitation_error(split))


class WithCritics:
    """Says that its first seed is off by 3, its second by 5."""

    def td_error(self, batch: Batch) -> Tensor:
        assert batch.rewards.shape == (2, BATCH_SIZE, N_AGENTS)
        assert torch.equal(batch.states[0], batch.states[1])
        return torch.tensor([9.0, 25.0])


def test_td_errors_are_the_root_of_what_an_algorithm_says() -> None:
    found = td_errors(WithCritics(), chain(5, ends=True), 2, "cpu")
    assert found is not None
    np.testing.assert_allclose(found, [3.0, 5.0])
    assert td_errors(object(), chain(5, ends=True), 2, "cpu") is None


@pytest.mark.parametrize("reward", ["own", "team"])
def test_the_td_error_of_maddpg_bc_is_its_critics_loss_and_changes_nothing(reward: Reward) -> None:
    dataset = chain(8, ends=False)
    batch = dataset.sampler(32).gather(np.arange(24)[None]).to_torch()
    config = MADDPGBCConfig(
        actor_hidden=(8,), critic_hidden=(8,), smoothing=0.0, max_grad_norm=None, reward=reward
    )
    statistics = Statistics.measure(dataset, config.discount)
    algorithm = MADDPGBC(Setup(Sizes.of(batch), [3], statistics), config)
    before = algorithm.critics.online.flat.clone()
    found = algorithm.td_error(batch)
    assert torch.equal(algorithm.critics.online.flat, before)
    loss = algorithm.update(batch)["critic_loss"]
    unit = statistics.own_return_std if reward == "own" else statistics.return_std
    torch.testing.assert_close(found, unit**2 * loss / 2)  # the loss is the sum over two critics
