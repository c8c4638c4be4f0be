"""The interface between tasks and physics, so that another simulator can replace Pymunk."""

from typing import NamedTuple, Protocol

from swarmdata.runtime.kernels import kernel
from swarmdata.specs.rules import Payload
from swarmdata.specs.state_layout import N_COLUMNS
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Counts, Double, Float, Int


class Plan(NamedTuple):
    """The parts of a world that are the same in every episode."""

    spec: TaskSpec
    kinds: Int  # [M] shape code of each obstacle, `geometry`
    movables: tuple[Payload, ...]  # K bodies that robots can push


class Contacts(NamedTuple):
    """The contacts of robots, from one physics step to the next."""

    robots: Bool  # [E, N, N] upper triangle: pairs in contact that have not separated
    obstacles: Bool  # [E, N, M + 4] contacts with obstacles, then walls
    slack: Double  # [E, N, 3] where a robot's gap to everything static was computed, and that gap,
    # or a lower bound of it


class Moving(NamedTuple):
    """What moves in C worlds whose episodes begin; limits and payloads may be those of all."""

    robots: Double  # [C, N, 6] with their velocities
    bodies: Double  # [C, K, 7] movable bodies, with their velocities
    limits: Double  # [N, 9] or [C, N, 9] of the robots, `dynamics.limits_of`
    payloads: Double  # [K, 5] or [C, K, 5] of the bodies, `episode_bodies.payload_rows`


@kernel(inline="always")
def write_state(robots: Double, bodies: Double, state: Float) -> None:
    """Writes one copy's robots [N, 6] and bodies [K, 7] to its state [S]; targets stay."""
    first = N_COLUMNS * robots.shape[0]
    for i in range(robots.shape[0]):
        for c in range(6):
            state[N_COLUMNS * i + c] = robots[i, c]
    for k in range(bodies.shape[0]):
        for c in range(7):
            state[first + 7 * k + c] = bodies[k, c]


class Backend(Protocol):
    """E copies of a physical world of circular robots.

    Commands change a robot's heading, contacts do not. The backend keeps positions and velocities
    in float64; states contain them rounded to float32.
    """

    def reset(self, copies: Int, layouts: Float, moving: Moving) -> None:
        """Starts new worlds in `copies`, [C], from which their history must not show in any bit.

        `layouts` [E, M, 8] are those of all copies, `moving` is in these copies.
        """
        ...

    def step(
        self, active: Bool, commands: Double, contacts: Contacts, events: Counts, states: Float
    ) -> None:
        """Advances the active copies by one control step.

        Args:
            active: [E].
            commands: in [-1, 1], for `dynamics.drive`, [E, N, 2].
            contacts: updated after every physics step.
            events: zeros, to which the events of every physics step are added, [E, N, 4].
            states: written: robots except their targets, and movable bodies, [E, S].
        """
        ...
