"""Bundles reach kernels as they are, and nothing but what the kernel expects is packed."""

import sys
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest

from swarmdata.runtime.argument_blocks import ArgumentBlock, bundle_type, unpack
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Bool, Double, Float, Int
from tests.support.interpreter import python


class Drive(NamedTuple):
    """One field of each kind."""

    limits: Annotated[Double, 2]
    is_turned: bool
    flags: Annotated[Bool, 1]
    dt: float
    n_steps: int
    states: Annotated[Float, 3]
    joints: Annotated[Int, 2]


DRIVE = bundle_type(Drive)


@kernel
def _read(packed: Int, sums: Double) -> tuple[bool, float, int, tuple[int, int], int]:
    drive = unpack(packed, DRIVE)
    sums[0], sums[1] = drive.limits[1].sum(), drive.states[1, 2].sum()
    drive.limits[0, 1] = -7.5
    flags = 0
    for k in range(drive.flags.shape[0]):
        flags += drive.flags[k] << k
    return drive.is_turned, drive.dt, drive.n_steps, drive.joints.shape, flags


def _drive() -> Drive:
    rng = np.random.default_rng(0)
    return Drive(
        limits=rng.uniform(-1, 1, (2, 3)),
        is_turned=True,
        flags=np.array([True, False, True]),
        dt=-0.1,
        n_steps=-(2**40),
        states=rng.uniform(-1, 1, (2, 3, 4)).astype(np.float32),
        joints=np.zeros((2, 0), np.int64),
    )


def test_a_kernel_reads_and_writes_the_bundle() -> None:
    drive, sums = _drive(), np.empty(2)
    block = ArgumentBlock(drive, DRIVE)
    for _ in range(1000):  # a counted reference would be dropped once too often
        found = _read(block.packed, sums)
    assert found == (True, -0.1, -(2**40), (2, 0), 0b101)
    np.testing.assert_allclose(sums, [drive.limits[1].sum(), drive.states[1, 2].sum()], rtol=1e-6)
    assert drive.limits[0, 1] == -7.5


def test_the_arrays_live_as_long_as_the_block() -> None:
    block, sums = ArgumentBlock(_drive(), DRIVE), np.empty(2)
    rows = [np.full((2, 3), 9.0) for _ in range(100)]  # take memory that was given back
    _read(block.packed, sums)
    assert sums[0] == pytest.approx(_drive().limits[1].sum())
    assert len(rows) == 100


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("limits", np.zeros((3, 2)).T),
        ("limits", np.zeros(3)),
        ("states", np.zeros((2, 3, 4))),
        ("dt", 1),
    ],
)
def test_another_type_is_refused(field: str, value: Any) -> None:
    with pytest.raises(TypeError, match=f"argument {field} is .*, expected"):
        ArgumentBlock(_drive()._replace(**{field: value}), DRIVE)


CLOSED_ALIASES = """
import sys; sys.path[:] = {path!r}
import numpy.typing
class Closed:
    def __class_getitem__(cls, item):
        return type("Alias", (), {{}})
numpy.typing.NDArray = Closed

from typing import Annotated, NamedTuple
from swarmdata.runtime.argument_blocks import bundle_type
from swarmdata.types import Bool, Double, Float, Int
class Fields(NamedTuple):
    flags: Annotated[Bool, 1]
    limits: Annotated[Double, 2]
    states: Annotated[Float, 3]
    joints: Annotated[Int, 4]
print(*((str(each.dtype), each.ndim, each.layout) for each in bundle_type(Fields).types))
"""
"""As if nothing could be read from NumPy's aliases, whose parts are others since NumPy 2.5."""


@pytest.mark.slow
def test_numpys_aliases_are_not_taken_apart() -> None:
    found = python("-c", CLOSED_ALIASES.format(path=sys.path), check=False)
    assert not found.stderr
    assert found.stdout.strip() == (
        "('bool', 1, 'C') ('float64', 2, 'C') ('float32', 3, 'C') ('int64', 4, 'C')"
    )
