"""The cost of a world, estimated from its spec alone, rather too high, and upper limits."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from swarmdata.specs.sensing_models import (
    BearingModel,
    Broadcast,
    LidarModel,
    OccupancyModel,
    StateModel,
)

if TYPE_CHECKING:
    from swarmdata.specs.task_spec import TaskSpec

MAX_ROBOTS = 1_024
MAX_OBSTACLES = 1_024
MAX_STACKED_FRAMES = 256  # of a stack
MAX_DELAY_STEPS = 1_000  # control steps, of a sensor or of the radio
MAX_HORIZON_STEPS = 1_000_000  # control steps
MAX_SUBSTEPS = 1_000  # physics steps in a control step
MAX_PLACES = 65_536  # where goods are picked or delivered
MAX_OBSERVATION_SIZE = 524_288  # numbers that one robot observes in a step
MAX_COPY_BYTES = 1 << 29  # of one copy of a world
MAX_EPISODE_BYTES = 1 << 32  # of one recorded episode in memory
MAX_STEP_SECONDS = 1.0  # of one copy's control step
MAX_DRAW_SECONDS = 5.0  # of giving up to draw one copy's layout
MAX_TOTAL_BYTES = 1 << 36  # of all copies together

N_DRAWS_OF_A_PLACE = 64  # attempts at one place, as in `envs.world.spawn`
MAP_SPACING = 0.1  # m, between the nodes of robots' maps, as in `perception.wayfinder`


class Size(NamedTuple):
    """The counts that determine the cost, beside the spec's own."""

    obstacles: int  # M
    places: int  # where goods are picked or delivered
    frame: int  # numbers in one frame of one robot's observation
    frames: int  # kept by the sensor: stack and delay
    observation: int  # numbers that one robot observes, messages included, O
    message: int  # numbers in one message
    links: int  # steps of messages in transit; 0: no communication
    ways: int  # that a robot observes; 0: robots have no map
    nodes: int  # of their map; 0: they have none
    state: int  # numbers in a state, S


class Demand(NamedTuple):
    """Memory and time of a world on one core of an ordinary machine."""

    copy_bytes: float
    episode_bytes: float
    step_seconds: float
    draw_seconds: float  # until drawing a layout is given up


def excesses(spec: "TaskSpec") -> Iterator[str]:
    """Yields a sentence for each limit that a spec exceeds: got, allowed, and what to reduce."""
    size = size_of(spec)
    substeps = spec.control_dt / spec.physics_dt
    counts = (
        ("team: {} robots (the sum of each count)", spec.n_agents, MAX_ROBOTS),
        ("obstacles: {} of them, shelves included", size.obstacles, MAX_OBSTACLES),
        ("rules: {} places where goods are picked or delivered", size.places, MAX_PLACES),
        ("observation.stack: {} frames", spec.observation.stack, MAX_STACKED_FRAMES),
        ("observation.delay: {} steps", spec.observation.delay, MAX_DELAY_STEPS),
        ("communication.delay: {} steps", max(size.links - 1, 0), MAX_DELAY_STEPS),
        ("horizon: {} steps", spec.horizon, MAX_HORIZON_STEPS),
        ("physics_dt: {} physics steps in control_dt", substeps, MAX_SUBSTEPS),
        (
            "observation: {} numbers for each robot (all frames, and messages)",
            size.observation,
            MAX_OBSERVATION_SIZE,
        ),
    )
    for what, got, most in counts:
        if got > most:
            yield f"{what.format(f'{got:,.0f}')}, at most {most:,} are allowed"
    demand = demand_of(spec)
    costs = list(_costs_too_much(spec, demand))
    yield from costs
    if not costs and any(got > most for _, got, most in counts):
        yield describe_demand(demand)


def _costs_too_much(spec: "TaskSpec", demand: Demand) -> Iterator[str]:
    team = f"team ({spec.n_agents:,} robots)"
    view = f"observation ({_sensor(spec, 0, 0).words} x {spec.observation.stack:,} frames)"
    horizon = f"horizon ({spec.horizon:,} steps)"
    attempts = f"spawn.max_attempts ({spec.spawn.max_attempts:,})"
    limits = (
        (
            "one copy of the world takes",
            MAX_COPY_BYTES,
            in_bytes,
            f"{team}, {view} or communication",
        ),
        ("one recorded episode takes", MAX_EPISODE_BYTES, in_bytes, f"{horizon}, {team} or {view}"),
        (
            "one control step takes",
            MAX_STEP_SECONDS,
            in_seconds,
            f"{team}, {view}, obstacles or control_dt / physics_dt",
        ),
        (
            "drawing a layout takes up to",
            MAX_DRAW_SECONDS,
            in_seconds,
            f"{attempts}, {team} or obstacles",
        ),
    )
    for got, (what, most, shown, reducible) in zip(demand, limits, strict=True):
        if got > most:
            yield (
                f"{what} about {shown(got)}, at most {shown(most)} are allowed: reduce {reducible}"
            )


def copies_excess(spec: "TaskSpec", n_copies: int) -> str | None:
    """The reason why that many copies of a world are refused, None if they are not."""
    one = demand_of(spec).copy_bytes
    if n_copies < 1 or one * n_copies > MAX_TOTAL_BYTES:
        return (
            f"{n_copies:,} copies of {spec.task} with {spec.n_agents:,} robots take about "
            f"{in_bytes(one * max(n_copies, 0))}, expected from 1 to "
            f"{int(MAX_TOTAL_BYTES / one):,} copies ({in_bytes(MAX_TOTAL_BYTES)})"
        )
    return None


def part_excess(spec: "TaskSpec", part_episodes: int) -> str | None:
    """The reason why parts of that many episodes are refused, None if they are not."""
    one = demand_of(spec).episode_bytes
    if part_episodes > 1 and one * part_episodes > MAX_TOTAL_BYTES:
        return (
            f"part_episodes is {part_episodes:,}: a part may take about "
            f"{in_bytes(one * part_episodes)} of memory, expected at most "
            f"{int(MAX_TOTAL_BYTES / one):,} episodes ({in_bytes(MAX_TOTAL_BYTES)})"
        )
    return None


def describe_demand(demand: Demand) -> str:
    """The estimate in words."""
    return (
        f"estimated: {in_bytes(demand.copy_bytes)} for a copy of the world, "
        f"{in_bytes(demand.episode_bytes)} for a recorded episode, "
        f"{in_seconds(demand.step_seconds)} for a control step"
    )


def size_of(spec: "TaskSpec") -> Size:
    """Counts the sizes in a spec, without building anything of that size."""
    n, task = spec.n_agents, spec.rules.demand(spec)
    frame = _sensor(spec, n, 0).frame + task.features
    roles = len(spec.team) if len(spec.team) > 1 else 0
    message = links = heard = 0
    channel = spec.communication
    if isinstance(channel, Broadcast):
        message = channel.message_size if channel.payload == "learned" else 8
        links, heard = channel.delay + 1, (n - 1) * (message + 3)
    ways = nodes = 0
    if spec.observation.ways:
        rows, columns = (size / MAP_SPACING + 1 for size in (spec.arena.height, spec.arena.width))
        ways, nodes = 2 * n + 4, int(rows * columns)
    return Size(
        obstacles=spec.obstacles.number + task.obstacles,
        places=task.places,
        frame=frame,
        frames=spec.observation.stack + spec.observation.delay,
        observation=frame * spec.observation.stack + roles + heard + 4 * ways,
        ways=ways,
        nodes=nodes,
        message=message,
        links=links,
        state=8 * n + task.columns,
    )


def demand_of(spec: "TaskSpec") -> Demand:
    """Estimates memory and time of a world."""
    size, n, substeps = size_of(spec), spec.n_agents, spec.control_dt / spec.physics_dt
    m, o = size.obstacles, size.observation
    links = n * n if size.links else 0
    # 18: numbers of a robot's action, log-probability, reward with its terms, and events
    one_step = 4 * (n * (o + size.message + 18) + size.state) + 2 * links
    history = 4 * n * size.frame * (size.frames + 1 if size.frames > 1 else 1)
    radio = links * 4 * (size.message + 2) + size.links * (4 * n * size.message + links)
    objects = 400 * o + 20_000 * n + 6_000 * m + 100 * size.places + 24 * n * n + spec.horizon
    map_bytes = size.nodes * (8 * (4 * n + 8) + 8)
    around = n + m + 4
    sensing = _sensor(spec, n, m).nanoseconds + n * o + links * (size.message + 4)
    matching = 2 * n**3 if spec.rules.demand(spec).is_matched else 0
    finding = n * (2_000 * size.ways + 10 * size.nodes)  # each robot plans in one step of ten
    physics = substeps * (500 * around + 2 * n * around)
    return Demand(
        copy_bytes=4 * one_step + history + radio + objects + map_bytes,
        episode_bytes=float(spec.horizon) * one_step,
        step_seconds=1e-9 * (sensing + matching + physics + finding + 10 * n * around),
        draw_seconds=1e-9 * spec.spawn.max_attempts * _draw_operations(spec, n, m),
    )


class _Sensor(NamedTuple):
    """What the observation model of a spec costs."""

    frame: int  # numbers of a frame, without those of the task
    nanoseconds: float  # of sensing, for all robots in one step
    words: str


def _sensor(spec: "TaskSpec", n: int, m: int) -> _Sensor:
    """The cost of sensing for n robots among m obstacles."""
    around = n + m + 4
    match spec.observation:
        case LidarModel(n_rays=rays):
            return _Sensor(12 + 5 * rays, 0.3 * n * around * rays, f"{rays:,} rays")
        case OccupancyModel(cells=cells):
            words = f"{cells:,} x {cells:,} cells"
            return _Sensor(12 + 4 * cells**2, 0.2 * n * around * cells**2, words)
        case BearingModel(n_neighbors=seen):
            return _Sensor(12 + 8 * seen, 1.0 * n * n * around, f"{seen:,} neighbors")
        case StateModel(n_neighbors=seen, n_obstacles=obstacles):
            slots, words = seen + obstacles, f"{seen:,} neighbors and {obstacles:,} obstacles"
            spent = n * around * (10.0 + 0.5 * min(slots, n + m))
            return _Sensor(12 + 8 * slots, spent, words)


def _draw_operations(spec: "TaskSpec", n: int, m: int) -> float:
    """Nanoseconds of a failed attempt: two draws of each place, and all draws of the last one.

    A draw takes 40, 1 more for each robot and 6 for each obstacle that it is compared with.
    """
    task = spec.rules.demand(spec)
    if not task.is_drawn:
        return 0.0
    one = 40.0 + 1.0 * n + 6.0 * m
    attempt = 2.0 * ((2 * n + m) * one) + N_DRAWS_OF_A_PLACE * one
    return attempt + task.attempt_nanoseconds


def in_bytes(n: float) -> str:
    """Bytes in the unit that suits them."""
    for unit in ("B", "KiB", "MiB", "GiB", "TiB", "PiB"):
        if n < 1024 or unit == "PiB":
            break
        n /= 1024
    return f"{n:,.3g} {unit}" if n < 1000 else f"{n:,.0f} {unit}"


def in_seconds(seconds: float) -> str:
    """A duration in the unit that suits it."""
    for unit, size in (("ms", 1e-3), ("s", 1.0), ("h", 3600.0), ("years", 3.15e7)):
        shown, named = seconds / size, unit
        if shown < 1000:
            break
    return f"{shown:,.3g} {named}" if shown < 1000 else f"{shown:,.0f} {named}"
