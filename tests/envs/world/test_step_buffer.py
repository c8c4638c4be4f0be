"""Steps are the caller's to keep, however many are made at once; ended copies stay as they are."""

from itertools import pairwise

import numpy as np
import pytest

from swarmdata.envs.world.step_buffer import (
    BLOCK_STEPS,
    LASTING_FIELDS,
    WRITTEN_FIELDS,
    StepMaker,
    keep_ended,
)
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Step, copy_step

TALKING = TaskSpec(communication={"kind": "broadcast"})  # type: ignore[arg-type]  # parsed


def first_step(spec: TaskSpec, n_copies: int) -> Step:
    return make_env(spec, n_copies).reset(np.arange(n_copies, dtype=np.uint64))


@pytest.mark.parametrize("n_copies", [1, 3, 64])
@pytest.mark.parametrize("spec", [TaskSpec(), TALKING], ids=["silent", "talking"])
def test_no_two_steps_share_what_is_written(spec: TaskSpec, n_copies: int) -> None:
    first = first_step(spec, n_copies)
    maker = StepMaker(first)
    steps = [first, *(maker.after(first) for _ in range(2 * BLOCK_STEPS + 3))]
    names = (*WRITTEN_FIELDS, "sent", "delivered", "ages") if spec is TALKING else WRITTEN_FIELDS
    for name in names:
        arrays = [getattr(step, name) for step in steps]
        assert {(a.shape, a.dtype) for a in arrays} == {(arrays[0].shape, arrays[0].dtype)}
        spans = sorted((a.ctypes.data, a.ctypes.data + a.nbytes) for a in arrays)
        assert all(left[1] <= right[0] for left, right in pairwise(spans))


def test_what_only_a_reset_changes_is_shared() -> None:
    first = first_step(TaskSpec(), 2)
    step = StepMaker(first).after(first)
    assert step.seeds is first.seeds
    assert step.layouts is first.layouts


@pytest.mark.parametrize("n_copies", [1, 64])
def test_steps_that_were_returned_never_change(n_copies: int) -> None:
    env = make_env(TaskSpec(horizon=30), n_copies)
    rng = np.random.default_rng(0)
    steps = [env.reset(np.arange(n_copies, dtype=np.uint64))]
    kept = [copy_step(steps[0])]
    for _ in range(40):  # ten steps longer than the episodes
        steps.append(env.step(rng.uniform(-1, 1, (n_copies, 4, 2))))
        kept.append(copy_step(steps[-1]))
    for step, copy in zip(steps, kept, strict=True):
        for name in Step._fields:
            np.testing.assert_array_equal(getattr(step, name), getattr(copy, name), err_msg=name)


def test_ended_copies_stay_as_they_are_with_zero_rewards() -> None:
    env = make_env(TaskSpec(horizon=3), 4)
    last = env.reset(np.arange(4, dtype=np.uint64))
    actions = np.ones((4, 4, 2))
    for _ in range(3):
        last = env.step(actions)
    env.reset(np.array([9], dtype=np.uint64), np.array([2]))
    now = env.step(actions)
    ended = np.array([0, 1, 3])
    assert now.times.tolist() == [3, 3, 1, 3]
    assert now.truncations.tolist() == [True, True, False, True]
    assert not now.rewards[ended].any()
    assert not now.reward_terms[ended].any()
    assert not now.events[ended].any()
    for name in ("observations", "states", "terminations", "successes", "seeds", "layouts"):
        np.testing.assert_array_equal(getattr(now, name)[ended], getattr(last, name)[ended])


def test_keep_ended_leaves_active_copies_alone() -> None:
    before = first_step(TaskSpec(), 3)
    now = StepMaker(before).after(before)
    for name in LASTING_FIELDS:
        getattr(now, name)[:] = 1
    keep_ended(before, now, np.array([True, False, True]))
    for name in LASTING_FIELDS:
        values = getattr(now, name)
        np.testing.assert_array_equal(values[1], getattr(before, name)[1])
        assert np.all(values[[0, 2]] == 1)
