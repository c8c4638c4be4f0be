"""Worlds that are open when the interpreter ends: nobody has to free what the process gives back.

Pymunk frees a space by a callback that uses its modules. When an interpreter ends, these may be
cleared before the last space is, and the callback would print a traceback for each.
"""

import atexit
from weakref import WeakSet

import pymunk

_SPACES: WeakSet[pymunk.Space] = WeakSet()


def leave_at_exit(space: pymunk.Space) -> None:
    """Leaves a space, with all that is in it, to the process if it outlives the interpreter."""
    _SPACES.add(space)


@atexit.register
def _leave_to_the_process() -> None:
    """Takes the callbacks away from all spaces that are left, and from what is in them."""
    for space in _SPACES:
        joints = (joint._constraint for joint in space.constraints)
        shapes = (shape._shape for shape in space.shapes)
        bodies = (body._body for body in (space.static_body, *space.bodies))
        for owned in (space._space, *joints, *shapes, *bodies):
            pymunk.space.ffi.gc(owned, None)
