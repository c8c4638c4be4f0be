"""The content of one picture: a step's arrays, checked against the spec and split by meaning."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.numerics.geometry import OBSTACLE
from swarmdata.registry.appearance import Appearance
from swarmdata.registry.components import appearance_of
from swarmdata.specs.sensing_models import LidarModel
from swarmdata.specs.state_layout import BODY, N_COLUMNS, UX, UY, VX, VY, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EVENTS, Bool, Counts, Double, Float

Messages = tuple[Bool, Bool | None]  # delivered, and attempted if known; [N, N] receivers, senders
_MIN_HEADING_SPEED = 0.02  # m/s; below this the direction of a velocity is noise


@dataclass(frozen=True)
class Scan:
    """Lidar ranges of each robot; the first ray is along its heading, the others evenly spaced."""

    distances: Double  # [N, K] m
    is_hit: Bool  # [N, K]
    shown: tuple[int, ...]  # robots whose rays are drawn


@dataclass(frozen=True)
class Scene:
    """One state of a world with everything that is drawn of it."""

    spec: TaskSpec
    layout: Float  # [M, 8] columns `geometry.OBSTACLE`
    robots: Double  # [N, 8] columns `state_layout.ROBOT`
    bodies: Double  # [B, 7] columns `state_layout.BODY`
    extras: Double  # the task's own part of the state
    trails: Double  # [K, N + B, 2] earlier positions of robots and bodies, oldest first
    touching: Bool  # [N]
    scan: Scan | None
    delivered: Bool  # [N, N] receivers, senders
    dropped: Bool  # [N, N]

    @property
    def look(self) -> Appearance:
        """How its task is drawn."""
        return appearance_of(self.spec)

    @cached_property
    def radii(self) -> Double:
        """Radius of each robot, m, [N]."""
        return np.array([robot.radius for robot in self.spec.robots])

    @cached_property
    def roles(self) -> tuple[int, ...]:
        """Number of each robot's role, N long."""
        return tuple(k for k, role in enumerate(self.spec.team) for _ in range(role.count))

    def heading(self, i: int) -> tuple[float, float] | None:
        """Returns the unit vector of robot `i`'s direction; None for a holonomic robot at rest."""
        if self.spec.robots[i].dynamics == "unicycle":
            x, y = self.robots[i, UX], self.robots[i, UY]
        else:
            x, y = self.robots[i, VX], self.robots[i, VY]
        length = float(np.hypot(x, y))
        return None if length < _MIN_HEADING_SPEED else (float(x) / length, float(y) / length)


def build_scene(
    spec: TaskSpec,
    layout: Float,
    state: Float,
    *,
    trails: Float | None = None,
    events: Counts | None = None,
    scan: Scan | None = None,
    messages: Messages | None = None,
) -> Scene:
    """Checks and splits the arrays of one step; the arguments are those of `draw`.

    Raises:
        SchemaError: an array does not fit the spec.
    """
    n = spec.n_agents
    if layout.ndim != 2 or layout.shape[1] != len(OBSTACLE):
        raise SchemaError(f"layout is {list(layout.shape)}, expected [M, 8] (geometry.OBSTACLE).")
    if state.ndim != 1 or not np.isfinite(state).all():
        raise SchemaError(f"state is {list(state.shape)}, expected [S] of finite numbers.")
    robots, bodies, extras = _split(spec, state)
    if events is not None and events.shape != (n, len(EVENTS)):
        raise SchemaError(f"events are {list(events.shape)}, expected [{n}, {len(EVENTS)}].")
    delivered, dropped = _links(n, messages)
    contacts = np.zeros((n, len(EVENTS)), np.uint8) if events is None else events
    return Scene(
        spec=spec,
        layout=layout,
        robots=robots,
        bodies=bodies,
        extras=extras,
        trails=_paths(spec, trails, len(state)),
        touching=contacts.max(axis=1) > 0,
        scan=scan,
        delivered=delivered,
        dropped=dropped,
    )


def n_bodies(spec: TaskSpec) -> int:
    """Returns the number of movable bodies in the task's states."""
    return len(appearance_of(spec).bodies)


def _split(spec: TaskSpec, states: Float) -> tuple[Double, Double, Double]:
    """Splits states [..., S]: robots [..., N, 8], bodies [..., B, 7] and the rest, as float64."""
    robots = robots_of(states, spec.n_agents)
    first, count = N_COLUMNS * spec.n_agents, n_bodies(spec)
    last = first + len(BODY) * count
    if states.shape[-1] < last:
        raise SchemaError(
            f"states are {list(states.shape)}, expected at least [..., {last}] for "
            f"{spec.n_agents} robots and {count} payload. Pass the spec that made them."
        )
    bodies = states[..., first:last].reshape(*states.shape[:-1], count, len(BODY))
    return robots.astype(np.float64), bodies.astype(np.float64), states[..., last:].astype(float)


def _paths(spec: TaskSpec, trails: Float | None, size: int) -> Double:
    if trails is None:
        return np.empty((0, spec.n_agents + n_bodies(spec), 2))
    if trails.ndim != 2 or trails.shape[1] != size:
        raise SchemaError(
            f"trails are {list(trails.shape)}, expected [K, {size}]: states like the one drawn."
        )
    robots, bodies, _ = _split(spec, trails)
    return np.concatenate([robots[..., :2], bodies[..., :2]], axis=1)


def _links(n: int, messages: Messages | None) -> tuple[Bool, Bool]:
    """Returns delivered and dropped messages, [N, N], without those of a robot to itself."""
    nothing = np.zeros((n, n), np.bool_)
    if messages is None:
        return nothing, nothing
    delivered, attempted = messages
    for name, array in (("delivered", delivered), ("attempted", attempted)):
        if array is not None and array.shape != (n, n):
            raise SchemaError(
                f"{name} is {list(array.shape)}, expected [{n}, {n}]: receivers, then senders."
            )
    others = ~np.eye(n, dtype=np.bool_)
    dropped = nothing if attempted is None else attempted.astype(bool) & ~delivered.astype(bool)
    return delivered.astype(bool) & others, dropped & others


def build_scan(
    spec: TaskSpec, distances: Float, reach: float | None = None, focus: int | None = None
) -> Scan:
    """Turns normalised distances into a scan.

    Args:
        spec: the task; a robot's range is the smaller of the model's and its own sensor's.
        distances: of each ray as a share of the range, 1 = nothing in range, [N, K].
        reach: range of the rays, m; needed if the spec's observation model is not a lidar.
        focus: the only robot whose rays are drawn; all by default.

    Raises:
        SchemaError: `distances` has the wrong shape or values, or the range is unknown.
    """
    n = spec.n_agents
    if distances.ndim != 2 or len(distances) != n or distances.shape[1] == 0:
        raise SchemaError(f"scan is {list(distances.shape)}, expected [{n}, K]: robots, rays.")
    if not ((distances >= 0) & (distances <= 1)).all():
        raise SchemaError("scan has values outside [0, 1], expected shares of the lidar's range.")
    if focus is not None and not 0 <= focus < n:
        raise SchemaError(f"focus is robot {focus}, expected 0 to {n - 1}.")
    if reach is None:
        if not isinstance(spec.observation, LidarModel):
            raise SchemaError(
                f"the spec observes by {spec.observation.kind!r}, so the range of its rays is "
                "unknown. Pass scan_range in metres."
            )
        reach = spec.observation.range
    reaches = np.array([min(reach, robot.sensor_range or reach) for robot in spec.robots])
    shown = tuple(range(n)) if focus is None else (focus,)
    return Scan(distances.astype(np.float64) * reaches[:, None], distances < 1, shown)
