"""The meaning of each column of each array in a dataset of one of our tasks."""

from itertools import pairwise

from swarmdata.errors import SchemaError, UnknownNameError
from swarmdata.interfaces import Task
from swarmdata.numerics.geometry import OBSTACLE_COLUMNS
from swarmdata.perception.comms.payloads import PAYLOAD_COLUMNS
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import reward_terms
from swarmdata.specs.features import UNITS, Feature
from swarmdata.specs.sensing_models import Broadcast
from swarmdata.specs.state_layout import N_COLUMNS, body_columns, pair, robot_columns
from swarmdata.specs.task_spec import Robot, TaskSpec
from swarmdata.types import EVENT_COLUMNS, Column

ACCELERATION_RANGES = {"max_acceleration", "mass", "wheel_grip"}
"""Fields of `Randomization` on which a robot's largest acceleration depends."""


def task_columns(task: Task) -> dict[str, tuple[Column, ...]]:
    """The columns of every array that has some, but `actions`, which may differ by robot.

    Raises:
        SpecError: a model of the spec does not fit its task.
    """
    return {
        "observations": observation_columns(task),
        "states": state_columns(task),
        "sent": _message_columns(task.spec),
        "events": EVENT_COLUMNS,
        "episodes/layouts": OBSTACLE_COLUMNS,
    }


def columns_of(task: Task, array: str, agent: int = 0) -> tuple[Column, ...]:
    """The columns of one row of an array such as `states`; of `actions`, those of an agent.

    Raises:
        UnknownNameError: no such array has columns.
        SchemaError: there is no such agent.
        SpecError: a model of the spec does not fit its task.
    """
    robots = task.spec.robots
    if not 0 <= agent < len(robots):
        raise SchemaError(f"agent {agent} of {len(robots)}, expected 0 to {len(robots) - 1}")
    known = task_columns(task) | {
        "actions": action_columns(robots[agent], task.spec),
        "reward_terms": term_columns(task),
    }
    known["layout"] = known.pop("episodes/layouts")
    if array not in known:
        raise UnknownNameError("array with columns", array, known)
    return known[array]


def term_columns(task: Task) -> tuple[Column, ...]:
    """Every term of a robot's reward: the value that is stored, without its weight, [R]."""
    return tuple(Column(term.name, f"{term.value}. {term.meaning}") for term in reward_terms(task))


def state_columns(task: Task) -> tuple[Column, ...]:
    """Every column of a state: robots, movable bodies, the task's own, [S]."""
    half, n_bodies = task.spec.half_size, len(task.movables)
    robots = robot_columns(half)
    bodies = ("payload",) if n_bodies == 1 else tuple(f"payload_{k}" for k in range(n_bodies))
    return (
        *(column for name in task.spec.agent_names for column in _of(name, robots)),
        *(column for name in bodies for column in _of(name, body_columns(half))),
        *task.extras,
    )


def planar_vectors(columns: tuple[Column, ...]) -> tuple[int, ...]:
    """Indices of the x components of vectors in the world's frame; their y components follow."""
    names = [column.name for column in columns]
    return tuple(
        k
        for k, (column, following) in enumerate(pairwise(columns))
        if column.frame == "world" and following.name == f"{names[k][:-1]}y"
    )


def state_layout(task: Task | None, state_size: int) -> tuple[int, tuple[int, ...]]:
    """Returns the columns of each robot in a state, and `planar_vectors`; 0 and () if unknown.

    States may be others than the task's, and have no task in recordings of other environments.
    """
    columns = () if task is None else state_columns(task)
    return (N_COLUMNS, planar_vectors(columns)) if len(columns) == state_size else (0, ())


def _of(name: str, columns: tuple[Column, ...]) -> tuple[Column, ...]:
    return tuple(column._replace(name=f"{name}.{column.name}") for column in columns)


def observation_columns(task: Task) -> tuple[Column, ...]:
    """Every column of one robot's observation, received messages included, [O]."""
    frame = "body" if task.spec.observation.in_body_frame else "world"
    return tuple(
        Column(
            feature.name,
            feature.meaning,
            UNITS.get(feature.kind, ""),
            *_bounds(feature),
            frame if feature.axis else "",
        )
        for feature in features_of(task)
    )


def _bounds(feature: Feature) -> tuple[float | None, float | None]:
    """Least and greatest value of a feature, however noisy its measurements are."""
    if feature.kind == "direction" or ".value_" in feature.name:
        return -1.0, 1.0
    return (0.0, 1.0) if feature.kind in ("range", "flag") else (None, None)


def action_columns(robot: Robot, spec: TaskSpec) -> tuple[Column, ...]:
    """Every column of one robot's action: its command, then a learned message, [A]."""
    message = _message_columns(spec) if spec.action_size > 2 else ()
    return (*_command_columns(robot, spec), *message)


def _command_columns(robot: Robot, spec: TaskSpec) -> tuple[Column, ...]:
    drawn = spec.randomization.ranges.keys()
    speed, acceleration, rate = (
        f"the episode's {name}" if drawn & ranges else f"{value:g} {unit}"
        for name, value, unit, ranges in (
            ("max_speed", robot.max_speed, "m/s", {"max_speed"}),
            ("acceleration", robot.acceleration, "m/s^2", ACCELERATION_RANGES),
            ("max_turn_rate", robot.max_turn_rate, "rad/s", {"max_turn_rate"}),
        )
    )
    is_velocity = robot.command == "velocity"
    limit = (
        f"approached with at most {acceleration}"
        if is_velocity
        else f"limited so that the speed stays within {speed}"
    )
    what = "velocity" if is_velocity else "acceleration"
    scale = speed if is_velocity else acceleration
    if robot.dynamics == "holonomic":
        more = f", as a fraction of {scale}, {limit}; a vector longer than 1 is shortened to 1"
        return pair(f"{what}_", f"commanded {what}", "", (1.0, 1.0), more)
    ahead = f"commanded {what} along the heading, as a fraction of {scale}, {limit}"
    turn = f"turn rate, counter-clockwise, as a fraction of {rate}"
    if robot.drive == "differential":
        turn += "; where the sizes of both fractions have a sum above 1, both are divided by it"
    return (
        Column(f"{what}_ahead", ahead, "", -1.0, 1.0, "body"),
        Column("turn_rate", turn, "", -1.0, 1.0),
    )


def _message_columns(spec: TaskSpec) -> tuple[Column, ...]:
    """Every value of a message as it is sent, [P]."""
    model = spec.communication
    if not isinstance(model, Broadcast):
        return ()
    if model.payload == "learned":
        said = "of the message, chosen by the sender; 0 in the first state of an episode"
        return tuple(
            Column(f"message_{k}", f"value {k} {said}", "", -1.0, 1.0)
            for k in range(model.message_size)
        )
    rounding = f", rounded to one of {1 << model.bits} values" if model.bits else ""
    own = robot_columns(spec.half_size)
    following = tuple(
        column._replace(
            name=f"next_{column.name}",
            meaning=f"of the robot after the sender{rounding}: {column.meaning}",
        )
        for column in own
    )
    measured = tuple(
        column._replace(meaning=f"of the sender, measured by itself{rounding}: {column.meaning}")
        for column in own
    )
    columns = (*measured, *following)
    sent = tuple(columns[k] for k in PAYLOAD_COLUMNS[model.payload])
    sensor = spec.observation
    is_noisy = sensor.noise.position > 0.0 or spec.randomization.noise is not None
    if not is_noisy and sensor.drift.position == 0.0:
        return sent
    # with noise or drift, a robot may measure a position outside of the arena
    return tuple(c._replace(low=None, high=None) if c.unit == "m" else c for c in sent)
