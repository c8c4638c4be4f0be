"""Steps are the caller's to keep, however many are made at once; ended copies stay as they are."""

from itertools import pairwise

import numpy as np
import pytest

from swarmdata.envs.world.task_env import (
    BLOCK_STEPS,
    LASTING_FIELDS,
    WRITTEN_FIELDS,
    StepMaker,
    keep_ended,
)
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Step

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
