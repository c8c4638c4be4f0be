"""The frame in which robots of a task observe and act, by the name of its anchor."""

from swarmdata.errors import SpecError
from swarmdata.perception.frames import Frame, find_frame
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.specs.origins import Spec


def frame_of(spec: Spec, anchor: str = "auto") -> Frame | None:
    """Returns the frame in which robots see and act; None for the world's, as data are recorded.

        >>> frame = swarmdata.frame_of(dataset.spec, "reference.heading")
        >>> batch = next(dataset.sampler(256, seed=0)).in_frame(frame)
        >>> policy = swarmdata.FunctionPolicy(act, frame=frame)

    `dataset.frame` is the default one.

    Args:
        spec: of a dataset. Recorded environments have only the world frame.
        anchor: as `frames.find_frame` takes it.

    Raises:
        SpecError: the task's observations have no such anchor.
    """
    if spec.world is None:
        if anchor not in ("auto", "world"):
            raise SpecError(
                f"frame {anchor!r}: the meaning of a recorded environment's features is unknown. "
                "Use frame 'world'."
            )
        return None
    return find_frame(features_of(make_task(spec.world)), anchor)
