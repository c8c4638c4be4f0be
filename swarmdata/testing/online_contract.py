"""check_online_algorithm, the contract of every algorithm that learns in worlds of its own."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from swarmdata.errors import CheckpointError
from swarmdata.interfaces import OnlineAlgorithm, Policy
from swarmdata.testing.comparing import (
    act_on,
    assert_equal_states,
    check_losses,
    check_policies,
    check_stacking,
    values_of,
)
from swarmdata.types import Step

Build = Callable[[Sequence[int], Path], OnlineAlgorithm]
"""Makes the algorithm for some seeds in a folder; everything else is fixed."""

STACKED_SEEDS = (3, 1)


def check_online_algorithm(
    build: Build,
    step: Step,
    folder: Path | str,
    *,
    n_rounds: int = 3,
    tolerance: float = 1e-5,
) -> None:
    """Checks an algorithm against `interfaces.OnlineAlgorithm` and the promises of stacked seeds.

    Args:
        build: makes the algorithm; it must have begun to learn after `n_rounds` updates.
        step: of the same task, to act on; at least 2 copies.
        folder: an empty one.
        n_rounds: updates of every comparison.
        tolerance: largest difference of an action between stacked and separate seeds.

    Raises:
        AssertionError: naming the broken promise.
    """
    folder = Path(folder)
    _check_updates(build, folder / "losses", n_rounds)
    run = build(STACKED_SEEDS, folder / "policies")
    check_policies(run.policy, lambda: _train(run, n_rounds), step)
    _check_kept(run.policy(0), step, folder / "policies" / "kept.safetensors")
    _check_resume(build, folder / "resume", n_rounds)

    def trained(seeds: Sequence[int]) -> OnlineAlgorithm:
        return _train(build(seeds, folder / f"stacking-{len(seeds)}-{seeds[0]}"), n_rounds)

    check_stacking(trained, STACKED_SEEDS, step, tolerance)


def _check_updates(build: Build, folder: Path, n_rounds: int) -> None:
    """Losses have the promised names, one value per seed, and are finite once learning began."""
    run = build(STACKED_SEEDS, folder)
    promised = set(type(run).LOSSES)  # type: ignore[attr-defined]
    frames = [run.frames]
    for _ in range(n_rounds):
        losses = run.update()
        frames.append(run.frames)
        assert set(losses) == promised, f"losses are {sorted(losses)}, not {sorted(promised)}"
        check_losses(losses, len(STACKED_SEEDS))
    for name, loss in losses.items():
        assert np.isfinite(values_of(loss)).all(), f"loss {name!r} is {loss}"
    steps = np.diff(frames)
    assert (steps > 0).all(), f"frames do not increase: {frames}"
    assert (steps == steps[0]).all(), f"rounds took {steps} frames"


def _check_kept(policy: Policy, step: Step, file: Path) -> None:
    """A run keeps its policies in files, from which they act as before."""
    from swarmdata.learn.policies.policy_file import load_policy, save_policy  # noqa: PLC0415  (torch)

    try:
        save_policy(file, policy)
    except CheckpointError as error:
        raise AssertionError(f"a run could not keep its policies: {error}") from error
    again = act_on(load_policy(file), step)
    assert np.array_equal(again, act_on(policy, step)), "a policy acts otherwise from its file"


def _check_resume(build: Build, folder: Path, n_rounds: int) -> None:
    """A run that was killed after a checkpoint, and resumed from it, goes the same way again."""
    killed = _train(build(STACKED_SEEDS, folder), n_rounds)
    saved = killed.state_dict()
    copies = {name: values_of(value).copy() for name, value in saved.items()}
    killed.restart_worlds()
    _train(killed, n_rounds)
    ours = killed.state_dict()
    resumed = build(STACKED_SEEDS, folder)
    resumed.load_state_dict(saved)
    assert resumed.frames * 2 == killed.frames, f"resumed at {resumed.frames} frames"
    _train(resumed, n_rounds)
    theirs = resumed.state_dict()
    assert_equal_states(saved, copies, "training wrote to a saved state")
    assert_equal_states(ours, theirs, "a resumed run went another way")


def _train(run: OnlineAlgorithm, n_rounds: int) -> OnlineAlgorithm:
    for _ in range(n_rounds):
        run.update()
    return run
