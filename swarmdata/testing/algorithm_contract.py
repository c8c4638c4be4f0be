"""check_algorithm, what every algorithm must do, whatever it learns.

    @pytest.mark.parametrize("name", OFFLINE_ALGORITHMS)
    def test_contract(name):
        check_algorithm(build=lambda seeds: ..., batch=lambda n_seeds, draw: ..., step=...)

Errors are AssertionErrors that say which promise was broken.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np

from swarmdata.interfaces import Algorithm
from swarmdata.testing.comparing import act_on, assert_equal_states, values_of
from swarmdata.types import Batch, Step

Build = Callable[[Sequence[int]], Algorithm]
"""Makes the algorithm for some seeds; everything else is fixed."""

Draw = Callable[[Sequence[int], int], Batch]
"""Returns the tensors [K, B, ...] that some seeds see in update number i; a pure function."""

STACKED_SEEDS = (3, 1, 4)


def check_algorithm(
    build: Build,
    draw: Draw,
    step: Step,
    *,
    n_updates: int = 50,
    tolerance: float = 1e-5,
) -> None:
    """Checks an algorithm against `interfaces.Algorithm` and the promises of stacked seeds.

    Args:
        build: makes the algorithm.
        draw: makes its batches.
        step: observations to act on, with at least 2 copies.
        n_updates: length of the comparison between stacked and separate seeds.
        tolerance: largest difference of an action in that comparison.
    """
    check_losses(build, draw)
    check_policy_of_seed(build, draw, step)
    check_resume(build, draw)
    check_stacking(build, draw, step, n_updates, tolerance)


def check_losses(build: Build, draw: Draw) -> None:
    """Losses are finite, one per seed, and updating does not write to the batch."""
    algorithm, batch = build(STACKED_SEEDS), draw(STACKED_SEEDS, 0)
    given = {f.name: getattr(batch, f.name) for f in fields(batch)}
    before = {k: values_of(v).copy() for k, v in given.items() if v is not None}
    for _ in range(3):
        losses = algorithm.update(batch)
        assert losses, "update returned no losses"
        for name, loss in losses.items():
            values = values_of(loss)
            assert values.shape == (len(STACKED_SEEDS),), f"loss {name!r} has shape {values.shape}"
            assert np.isfinite(values).all(), f"loss {name!r} is {values}"
            assert not loss.requires_grad, f"loss {name!r} keeps the graph alive"
    for name, old in before.items():
        unchanged = np.array_equal(values_of(getattr(batch, name)), old)
        assert unchanged, f"update wrote to the batch's {name}"


def check_policy_of_seed(build: Build, draw: Draw, step: Step) -> None:
    """Policies act in [-1, 1], copy by copy, and are snapshots."""
    algorithm = build(STACKED_SEEDS)
    policy = algorithm.policy(0)
    actions = act_on(policy, step)
    n_copies, n_agents = step.observations.shape[:2]
    assert actions.dtype == np.float32, f"actions have dtype {actions.dtype}"
    assert actions.shape[:2] == (n_copies, n_agents), f"actions have shape {actions.shape}"
    assert np.abs(actions).max() <= 1, "actions leave [-1, 1]"
    sure = policy.log_probs(step, actions)
    assert sure.dtype == np.float32, f"log_probs have dtype {sure.dtype}"
    assert sure.shape == (n_copies, n_agents), f"log_probs have shape {sure.shape}"
    assert not sure.any(), "a greedy policy is not sure of its own actions"
    single = act_on(policy, Step._make(field[:1] for field in step))
    assert np.array_equal(single, actions[:1]), "actions depend on the other copies"
    other = act_on(algorithm.policy(1), step)
    assert not np.array_equal(other, actions), "seeds 0 and 1 begin with the same policy"
    for index in range(4):
        algorithm.update(draw(STACKED_SEEDS, index))
    assert np.array_equal(act_on(policy, step), actions), "training changed a policy handed out"
    after = act_on(algorithm.policy(0), step)
    assert not np.array_equal(after, actions), "training did not change the policy"


def check_resume(build: Build, draw: Draw) -> None:
    """A state restored into a fresh algorithm continues bit for bit; a state is a snapshot."""
    original = build(STACKED_SEEDS)
    for index in range(5):
        original.update(draw(STACKED_SEEDS, index))
    saved = original.state_dict()
    copies = {name: values_of(value).copy() for name, value in saved.items()}
    resumed = build([seed + 100 for seed in STACKED_SEEDS])
    resumed.load_state_dict(saved)
    for algorithm in (original, resumed):
        for index in range(5, 10):
            algorithm.update(draw(STACKED_SEEDS, index))
    assert_equal_states(saved, copies, "training wrote to a saved state")
    ours, theirs = original.state_dict(), resumed.state_dict()
    assert_equal_states(ours, theirs, "a resumed algorithm went another way")


def check_stacking(build: Build, draw: Draw, step: Step, n_updates: int, tolerance: float) -> None:
    """K stacked seeds end with the policies that K separate runs end with."""
    stacked = build(STACKED_SEEDS)
    for index in range(n_updates):
        stacked.update(draw(STACKED_SEEDS, index))
    for position, seed in enumerate(STACKED_SEEDS):
        alone = build([seed])
        for index in range(n_updates):
            alone.update(draw([seed], index))
        ours, theirs = (act_on(p, step) for p in (stacked.policy(position), alone.policy(0)))
        gap = float(np.abs(ours - theirs).max())
        assert gap <= tolerance, f"seed {seed} differs by {gap:.1e} when it is stacked"
