"""What stands between a task and physics, so that another simulator can take Pymunk's place."""

from typing import NamedTuple, Protocol

from swarmdata.types import Bool, Counts, Double, Float, Int


class Contacts(NamedTuple):
    """Who touches whom, and the safety events of the running control step."""

    robots: Bool  # [E, N, N] upper triangle: pairs in contact and not yet separated
    obstacles: Bool  # [E, N, M + 4] robots in contact with obstacles, then walls
    slack: Double  # [E, N, 3] where, and how far from everything static, a robot last was
    events: Counts  # [E, N, 4] columns types.EVENTS


class Backend(Protocol):
    """E copies of a physical world of circular robots of mass 1 kg that never rotate."""

    positions: Double  # [E, N, 2] m
    velocities: Double  # [E, N, 2] m/s

    def reset(self, copies: Int, layouts: Float, starts: Double) -> None:
        """Puts fresh worlds into `copies`: obstacles `layouts` [E, M, 8], robots at rest [E, N, 2].

        What follows must not depend, in any bit, on what these copies did before.
        """
        ...

    def step(self, active: Bool, accelerations: Double, contacts: Contacts) -> None:
        """Advances the active copies by one control step under constant accelerations [E, N, 2].

        Events of the active copies are cleared first, then counted after every physics step.
        """
        ...
