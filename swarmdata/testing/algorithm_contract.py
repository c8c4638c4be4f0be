"""check_algorithm, the contract of every offline algorithm."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from swarmdata.interfaces import Algorithm, fields_of
from swarmdata.testing.comparing import (
    act_on,
    assert_equal_states,
    check_losses,
    check_policies,
    check_stacking,
    values_of,
)
from swarmdata.testing.sample_batches import sample_batch, sample_setup, sample_step
from swarmdata.types import Batch, Step

Build = Callable[[Sequence[int]], Algorithm]
"""Makes the algorithm for some seeds; everything else is fixed."""

Draw = Callable[[Sequence[int], int], Batch]
"""Returns the tensors [K, B, ...] that some seeds see in update number i; a pure function."""

STACKED_SEEDS = (3, 1, 4)


def check_algorithm(
    algorithm: type | Build,
    draw: Draw = sample_batch,
    step: Step | None = None,
    *,
    config: Any = None,
    n_updates: int = 50,
    tolerance: float = 1e-5,
    are_choices: bool = False,
) -> None:
    """Checks an algorithm against `interfaces.Algorithm` and the promises of stacked seeds.

    Args:
        algorithm: the class, which is built as `algorithm(setup, config)` for random transitions of
            3 robots; or a function that makes it for some seeds.
        draw: makes its batches; by default random transitions.
        step: observations to act on, with at least 2 copies; None: random ones.
        config: of a class; None: `algorithm.Config()`.
        n_updates: length of the comparison between stacked and separate seeds.
        tolerance: largest difference of an action in that comparison.
        are_choices: whether actions are choices, whole numbers, and not numbers in [-1, 1]; `draw`
            must give such. A greedy choice seldom changes, so `step` needs some hundred copies.

    Raises:
        AssertionError: naming the broken promise.
    """
    build = _builder(algorithm, config) if isinstance(algorithm, type) else algorithm
    step = sample_step() if step is None else step
    draw = _declared_only(type(build(STACKED_SEEDS)), draw)
    _check_updates(build, draw)
    _check_policy_of_seed(build, draw, step, are_choices)
    _check_resume(build, draw)

    def trained(seeds: Sequence[int]) -> Algorithm:
        return _train(build(seeds), draw, seeds, range(n_updates))

    check_stacking(trained, STACKED_SEEDS, step, tolerance)


def _declared_only(kind: type, draw: Draw) -> Draw:
    """Draws batches that have the fields that the algorithm declares, as training does."""
    if (declared := fields_of(kind)) is None:
        return draw
    absent = {f.name: None for f in fields(Batch) if f.name not in {*declared, "mask"}}
    return lambda seeds, index: replace(draw(seeds, index), **absent)


def _builder(kind: Any, config: Any) -> Build:
    settings = kind.Config() if config is None else config

    def build(seeds: Sequence[int]) -> Algorithm:
        algorithm: Algorithm = kind(sample_setup(seeds), settings)
        return algorithm

    return build


def _train(algorithm: Algorithm, draw: Draw, seeds: Sequence[int], updates: range) -> Algorithm:
    for index in updates:
        algorithm.update(draw(seeds, index))
    return algorithm


def _check_updates(build: Build, draw: Draw) -> None:
    """Losses are finite, one per seed, and updating does not write to the batch."""
    algorithm, batch = build(STACKED_SEEDS), draw(STACKED_SEEDS, 0)
    given = {f.name: getattr(batch, f.name) for f in fields(batch)}
    before = {k: values_of(v).copy() for k, v in given.items() if v is not None}
    for _ in range(3):
        losses = algorithm.update(batch)
        assert losses, "update returned no losses"
        check_losses(losses, len(STACKED_SEEDS))
        for name, loss in losses.items():
            assert np.isfinite(values_of(loss)).all(), f"loss {name!r} is {values_of(loss)}"
    for name, old in before.items():
        unchanged = np.array_equal(values_of(getattr(batch, name)), old)
        assert unchanged, f"update wrote to the batch's {name}"


def _check_policy_of_seed(build: Build, draw: Draw, step: Step, are_choices: bool) -> None:
    """Policies act in [-1, 1], copy by copy, and are snapshots; their actions are certain."""
    algorithm = build(STACKED_SEEDS)
    policy = algorithm.policy(0)
    log_probs = policy.log_probs(step, act_on(policy, step))
    assert log_probs.dtype == np.float32, f"log_probs have dtype {log_probs.dtype}"
    shape = step.observations.shape[:2]
    assert log_probs.shape == shape, f"log_probs have shape {log_probs.shape}"
    assert not log_probs.any(), "a greedy policy's log-probabilities of its actions are not 0"
    check_policies(
        algorithm.policy,
        lambda: _train(algorithm, draw, STACKED_SEEDS, range(4)),
        step,
        are_choices=are_choices,
    )


def _check_resume(build: Build, draw: Draw) -> None:
    """A state restored into a fresh algorithm continues bit for bit; a state is a snapshot."""
    original = _train(build(STACKED_SEEDS), draw, STACKED_SEEDS, range(5))
    saved = original.state_dict()
    for name, value in saved.items():
        kind = type(value).__name__
        assert hasattr(value, "shape"), f"state_dict()[{name!r}] is a {kind}, expected a tensor"
    copies = {name: values_of(value).copy() for name, value in saved.items()}
    resumed = build([seed + 100 for seed in STACKED_SEEDS])
    resumed.load_state_dict(saved)
    for algorithm in (original, resumed):
        _train(algorithm, draw, STACKED_SEEDS, range(5, 10))
    assert_equal_states(saved, copies, "training wrote to a saved state")
    ours, theirs = original.state_dict(), resumed.state_dict()
    assert_equal_states(ours, theirs, "a resumed algorithm went another way")
