"""What stands between a task and physics, so that another simulator can take Pymunk's place."""

from typing import NamedTuple, Protocol

from swarmdata.spec import Payload, TaskSpec
from swarmdata.types import Bool, Counts, Double, Float, Int


class Plan(NamedTuple):
    """What a world consists of, the same in every episode."""

    spec: TaskSpec
    kinds: Int  # [M] shape code of each obstacle, `geometry`
    movables: tuple[Payload, ...]  # K bodies that robots can push


class Contacts(NamedTuple):
    """Who touches whom, and the safety events of the running control step."""

    robots: Bool  # [E, N, N] upper triangle: pairs in contact and not yet separated
    obstacles: Bool  # [E, N, M + 4] robots in contact with obstacles, then walls
    slack: Double  # [E, N, 3] where, and how far from everything static, a robot last was
    events: Counts  # [E, N, 4] columns types.EVENTS


class Backend(Protocol):
    """E copies of a physical world of circular robots of mass 1 kg.

    Robots have a heading that commands change and contacts do not.
    """

    robots: Double  # [E, N, 6] the columns of `states.ROBOT` up to the heading
    bodies: Double  # [E, K, 7] columns `states.BODY`

    def reset(self, copies: Int, layouts: Float, robots: Double, bodies: Double) -> None:
        """Puts fresh worlds into `copies`: obstacles [E, M, 8], robots [E, N, 6], bodies [E, K, 7].

        All are at rest. What follows must not depend, in any bit, on what these copies did before.
        """
        ...

    def step(self, active: Bool, commands: Double, contacts: Contacts) -> None:
        """Advances the active copies by one control step under commands in [-1, 1], [E, N, 2].

        Robots are driven by `dynamics.drive`. Events of the active copies are cleared first, then
        counted after every physics step.
        """
        ...
