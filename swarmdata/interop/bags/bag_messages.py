"""The messages of a dataset in a bag: what robots of a real team would log, and every array.

For each robot of our tasks:

    /<robot>/pose          geometry_msgs/PoseStamped, in the frame `world`
    /<robot>/velocity      geometry_msgs/TwistStamped, in the frame `world`
    /<robot>/goal          geometry_msgs/PoseStamped: its target, in the frame `world`
    /<robot>/command       geometry_msgs/TwistStamped: commanded velocity and turn rate, as worlds
                           clip them; in the frame `world`, of unicycles in their own
    /<robot>/acceleration  geometry_msgs/AccelStamped: likewise, where the speed is commanded by an
                           acceleration
    /<robot>/scan          sensor_msgs/LaserScan, where robots observe the beams of a lidar

Every array of an episode is a topic too, one message a row: /team/observations, for example, in
std_msgs/Float32MultiArray, or UInt8MultiArray for whole numbers and flags. /team/episode is a
std_msgs/String of JSON, and /team/layout the obstacles; both come once an episode.

The first episode begins a second after the epoch, each other one `EPISODE_GAP` seconds after the
last state before it. States are stamped with their time, actions with the time at which they
begin, and rewards, ends and events with the time after the step. Where the time step is not known,
it is taken for a second.
"""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.dataset_facts import STATE_ARRAYS, array_names
from swarmdata.perception.observer import features_of
from swarmdata.perception.sensing.scans import scan_of
from swarmdata.registry.components import make_task
from swarmdata.runtime.extras import require_extra
from swarmdata.specs.features import Feature
from swarmdata.specs.sensing_models import LidarModel
from swarmdata.specs.state_layout import TX, TY, UX, UY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import SPLITS, EpisodeTable
from swarmdata.types import END_REASONS, Double, Episode, Float

EPISODE_GAP = 10.0  # seconds from the last state of an episode to the first of the next one
WORLD = "world"  # frame of poses, velocities, and the commands of holonomic robots

_AT_START = (*STATE_ARRAYS, "actions", "log_probs")
"""Arrays whose row k has the time of state k; row k of others has that of state k + 1."""

_SECOND = 10**9  # ns


@dataclass(frozen=True, slots=True)
class Message:
    """One message of a bag."""

    topic: str
    kind: str  # such as `std_msgs/msg/String`
    time: int  # ns
    fields: Mapping[str, Any]  # by name; messages inside it are mappings, too


def messages_of(dataset: Dataset) -> Iterator[Message]:
    """Yields the messages of a view of a dataset, in the order of their times."""
    names, world, table = array_names(dataset), dataset.spec.world, dataset.episodes
    features = () if world is None else features_of(make_task(world))
    step, start = (dataset.spec.time_step or 1.0) * _SECOND, _SECOND
    for k, episode in enumerate(dataset):
        times = [start + round(row * step) for row in range(len(episode) + 1)]
        yield _facts(dataset, table, k, times[0])
        if episode.layout.size:
            yield _array("/team/layout", episode.layout, times[0])
        for row, time in enumerate(times):
            yield from _rows(names, episode, row, time)
            if world is not None:
                yield from _robots(world, features, episode, row, time)
        start = times[-1] + round(EPISODE_GAP * _SECOND)


def _facts(dataset: Dataset, table: EpisodeTable, k: int, time: int) -> Message:
    """What the table of a view says of its episode k."""
    facts = {
        "episode": int(dataset.selection[k]),
        "steps": int(table.lengths[k]),
        "seed": int(table.seeds[k]),
        "policy": dataset.recipe.policies[int(table.policy[k])].label,
        "split": SPLITS[int(table.split[k])],
        "end": END_REASONS[int(table.end_reason[k])],
    }
    return Message("/team/episode", "std_msgs/msg/String", time, {"data": json.dumps(facts)})


def _rows(names: tuple[str, ...], episode: Episode, row: int, time: int) -> Iterator[Message]:
    """The row of every array that is stamped with the time of a state."""
    for name in names:
        index = row if name in _AT_START else row - 1
        values = getattr(episode, name)
        if 0 <= index < len(values):
            yield _array(f"/team/{name}", values[index], time)


def _array(topic: str, values: NDArray[Any], time: int) -> Message:
    kind, dtype = "std_msgs/msg/Float32MultiArray", np.float32
    if values.dtype != np.float32:
        kind, dtype = "std_msgs/msg/UInt8MultiArray", np.uint8  # type: ignore[assignment]
    sizes = values.shape or (1,)
    strides = [math.prod(sizes[axis:]) for axis in range(len(sizes))]
    dims = [
        {"label": str(axis), "size": size, "stride": stride}
        for axis, (size, stride) in enumerate(zip(sizes, strides, strict=True))
    ]
    data = np.ascontiguousarray(values, dtype).reshape(-1)
    return Message(topic, kind, time, {"layout": {"dim": dims, "data_offset": 0}, "data": data})


def _robots(
    world: TaskSpec, features: tuple[Feature, ...], episode: Episode, row: int, time: int
) -> Iterator[Message]:
    """What each robot logs at one time."""
    robots = robots_of(episode.states[row], world.n_agents).tolist()
    scans = scan_of(features, episode.observations[row])
    for i, (name, columns) in enumerate(zip(world.agent_names, robots, strict=True)):
        header = _header(time, WORLD)
        yield Message(f"/{name}/pose", "geometry_msgs/msg/PoseStamped", time, {
            "header": header, "pose": _pose(columns[X], columns[Y], columns[UX], columns[UY]),
        })  # fmt: skip
        yield Message(f"/{name}/velocity", "geometry_msgs/msg/TwistStamped", time, {
            "header": header, "twist": _twist(columns[VX], columns[VY], 0.0),
        })  # fmt: skip
        yield Message(f"/{name}/goal", "geometry_msgs/msg/PoseStamped", time, {
            "header": header, "pose": _pose(columns[TX], columns[TY], 1.0, 0.0),
        })  # fmt: skip
        if scans is not None:
            yield _scan(world, name, scans[i], time)
        if row < len(episode):
            command = command_of(world, i, episode.actions[row, i, :2].astype(np.float64))
            yield from _commands(world, i, command.tolist(), time)


def command_of(world: TaskSpec, robot: int, action: Double) -> Double:
    """The command [2] that a robot's action [2] is, as `envs.physics.dynamics` scales and clips it.

    Holonomic: velocity, m/s, or acceleration, m/s^2, in the world's frame. Unicycle: forward speed,
    m/s, or acceleration, m/s^2, and turn rate, rad/s.
    """
    body = world.robots[robot]
    most = body.max_speed if body.command == "velocity" else body.acceleration
    if body.dynamics == "unicycle":
        action, scale = np.clip(action, -1.0, 1.0), np.array([most, body.max_turn_rate])
    else:
        scale = np.array([most, most])
    if body.command_norm is not None:
        action = action / max(1.0, float(np.linalg.norm(action, body.command_norm)))
    return action * scale


def _commands(world: TaskSpec, i: int, command: list[float], time: int) -> Iterator[Message]:
    body, name = world.robots[i], world.agent_names[i]
    is_unicycle, is_speed = body.dynamics == "unicycle", body.command == "velocity"
    linear = (command[0], 0.0 if is_unicycle else command[1])
    turn_rate = command[1] if is_unicycle else 0.0
    header = _header(time, name if is_unicycle else WORLD)
    if is_speed or is_unicycle:
        twist = _twist(*(linear if is_speed else (0.0, 0.0)), turn_rate)
        yield Message(f"/{name}/command", "geometry_msgs/msg/TwistStamped", time, {
            "header": header, "twist": twist,
        })  # fmt: skip
    if not is_speed:
        yield Message(f"/{name}/acceleration", "geometry_msgs/msg/AccelStamped", time, {
            "header": header, "accel": _twist(*linear, 0.0),
        })  # fmt: skip


def _scan(world: TaskSpec, name: str, distances: Float, time: int) -> Message:
    """A scan; the distance of a beam that hits nothing is infinite (REP 117)."""
    model = world.observation
    assert isinstance(model, LidarModel)  # others have no beams
    reach = model.range
    step = 2 * math.pi / model.n_rays
    ranges = np.where(distances < 1.0, distances * np.float32(reach), np.float32(np.inf))
    return Message(f"/{name}/scan", "sensor_msgs/msg/LaserScan", time, {
        "header": _header(time, name), "angle_min": 0.0, "angle_max": 2 * math.pi - step,
        "angle_increment": step, "time_increment": 0.0, "scan_time": world.time_step,
        "range_min": 0.0, "range_max": reach, "ranges": ranges.astype(np.float32),
        "intensities": np.zeros(0, np.float32),
    })  # fmt: skip


def _header(time: int, frame: str) -> dict[str, Any]:
    seconds, rest = divmod(time, _SECOND)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def _pose(x: float, y: float, ux: float, uy: float) -> dict[str, Any]:
    """A pose in the plane whose x axis points along (ux, uy)."""
    half = math.atan2(uy, ux) / 2
    turn = {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)}
    return {"position": {"x": x, "y": y, "z": 0.0}, "orientation": turn}


def _twist(x: float, y: float, turn_rate: float) -> dict[str, Any]:
    linear, angular = {"x": x, "y": y, "z": 0.0}, {"x": 0.0, "y": 0.0, "z": turn_rate}
    return {"linear": linear, "angular": angular}


def open_types(frame: str) -> Any:
    """The types of ROS 2 Humble, for actions in the world's frame; others are refused."""
    if frame != "world":
        raise ConversionError(
            f"bags hold commands in the frame of the world or of a robot, got frame={frame!r}. "
            "Leave --frame out."
        )
    for package in ("rosbags", "mcap"):
        require_extra(package, "logs", "writing bags")
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415  (an extra)

    return get_typestore(Stores.ROS2_HUMBLE)


def serialized(types: Any, message: Message) -> bytes:
    """Bytes of a message in CDR."""
    return bytes(types.serialize_cdr(built(types, message.kind, message.fields), message.kind))


def built(types: Any, kind: str, fields: Mapping[str, Any]) -> Any:
    """An instance of a message's class, in which mappings are messages, too."""

    def value(field: Any, given: Any) -> Any:
        if isinstance(given, Mapping):
            return built(types, field[1], given)
        return [value(field[1][0], each) for each in given] if isinstance(given, list) else given

    _, definitions = types.fielddefs[kind]
    return types.types[kind](**{name: value(field, fields[name]) for name, field in definitions})
