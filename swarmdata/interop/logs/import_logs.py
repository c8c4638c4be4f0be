"""Makes a dataset of the logs of robots."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, SpecError, list_of
from swarmdata.interop.convert import store_imported
from swarmdata.interop.logs.clock_offsets import align_commands
from swarmdata.interop.logs.episode_windows import find_windows, make_episodes, most_steps
from swarmdata.interop.logs.open_logs import OpenLogs
from swarmdata.interop.logs.planar_frames import PlanarFrames
from swarmdata.interop.logs.resampling import make_grid
from swarmdata.interop.logs.robot_signals import SignalReader
from swarmdata.interop.logs.robot_tracks import (
    POSE_SPACE,
    RobotTrack,
    doubts,
    make_track,
    span_of,
    with_bounds,
)
from swarmdata.interop.logs.scored_episodes import check_task, score_episodes
from swarmdata.registry.presets import find_spec
from swarmdata.runtime.documents import read_document
from swarmdata.runtime.locking import locked
from swarmdata.runtime.output_folder import check_marked
from swarmdata.specs.frozen import differences
from swarmdata.specs.origins import RecordedSpec
from swarmdata.specs.origins.log_map import LogMap
from swarmdata.specs.origins.log_origin import EstimatedClock, ImportedLogs
from swarmdata.specs.origins.recording_origin import NUMBERED_SEEDS
from swarmdata.specs.recipe import Splits
from swarmdata.specs.spaces import width
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.layout import MANIFEST
from swarmdata.types import Episode

_LOG = logging.getLogger("swarmdata")

IMPORT_VERSION = "2"
"""Version of the rules of this folder: the same logs, map and version give the same dataset."""

MOST_NOTED = 4000  # characters of a list of topics or columns on the card


def shipped_maps() -> dict[str, Path]:
    """The maps of public logs that the package has, by name."""
    folder = Path(__file__).parent / "maps"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def read_map(source: Path | str) -> LogMap | ImportedLogs:
    """Reads a map by its path or its name in `shipped_maps`, or the `recipe.json` of an import."""
    path = Path(source).expanduser()
    if not path.exists():
        path = shipped_maps().get(str(source), path)
    content = read_document(path)
    if isinstance(content, Mapping) and "kind" in content:
        if content["kind"] != "logs":
            raise SpecError(
                f"{path} is of a dataset that was not made of logs (kind {content['kind']!r}), "
                "expected a map, or the recipe.json of an imported dataset"
            )
        return ImportedLogs.parse(content, str(path))
    return LogMap.parse(content, str(path))


def import_logs(
    logs: Sequence[Path | str] | Path | str,
    out: Path | str,
    *,
    log_map: LogMap | Path | str,
    id: str,
    task: TaskSpec | Path | str | None = None,
    splits: Splits | None = None,
    seed: int = 0,
    metadata: Mapping[str, str] | None = None,
) -> Dataset:
    """Makes a dataset of logs of robots: tables (CSV, Parquet) and bags (ROS 1, ROS 2, MCAP).

    The logger `swarmdata` warns of robots whose poses do not follow their commands by a factor of
    three, and of robots that are never there at the same time.

    With a task, the dataset is one of this task: its functions compute observations, messages,
    rewards, events and ends from the logged poses, and `load` observes it through other models.

    The resampled log is held in memory. A killed import leaves nothing at `out`; run it again.

    Args:
        logs: files, bags, and folders of files.
        out: where the dataset appears once it is complete.
        log_map: which columns and topics are poses, commands and observations, or its YAML
            file, or the name of a map that the package has, such as `mrclam`.
        id: id of the dataset, such as `hall-monday-v0`; its first part names the environment, or
            the task.
        task: a spec of `coop_nav` with these robots, its file, or the name of a preset; None: the
            logs have no task.
        splits: how many episodes are held out.
        seed: seed of the splits.
        metadata: information for readers, such as the author and license.

    Raises:
        DatasetNotFoundError: there is no log at a path.
        SpecError: the map is malformed, or does not say what the task needs.
        ConversionError: the logs and the map do not fit together, or nothing is left, or logs do
            not determine an offset of clocks.
        MissingExtraError: the logs' format needs a library that is not installed.
        OutputError: something else is at `out`.
        BuildError: another dataset is at `out`, or no episode falls into the train split.
    """
    out = _checked(out)
    if not isinstance(log_map, LogMap):
        given = read_map(log_map)
        if isinstance(given, ImportedLogs):
            raise SpecError(
                f"{log_map} is the recipe of {given.id}, expected a map; `swarmdata import --map` "
                "or `remake_logs` makes that dataset again"
            )
        log_map = given
    if task is not None and not isinstance(task, TaskSpec):
        task = find_spec(str(task))
    if task is not None and not id.startswith(f"{task.task}-"):
        raise SpecError(f"id {id!r} of a dataset of the task has to begin with {task.task}-")
    open_logs = _opened(logs, log_map)
    episodes, tracks, clocks, notes = _read(open_logs, log_map, task)
    content = {
        "id": id,
        "spec": task or _spec(tracks, log_map, id.partition("-")[0]),
        "policies": ({"label": log_map.policy, "name": "external"},),
        "seed": seed,
        "splits": splits or Splits(),
        "files": open_logs.files(),
        "log_map": log_map,
        "clocks": clocks,
        "metadata": {**notes, **(metadata or {})},
    }
    origin = ImportedLogs.parse(content, f"the import of {', '.join(open_logs.paths)}")
    return _stored(open_logs, out, origin, episodes)


def remake_logs(
    logs: Sequence[Path | str] | Path | str, out: Path | str, origin: ImportedLogs
) -> Dataset:
    """Makes an imported dataset again from the same logs, with the same digest.

    Args:
        logs: as in `import_logs`.
        out: where the dataset appears once it is complete.
        origin: of the dataset, its `recipe.json`.

    Raises:
        ConversionError: the logs are not those that the dataset was made of.
        OutputError: something else is at `out`.
        BuildError: another dataset is at `out`.
    """
    out = _checked(out)
    open_logs = _opened(logs, origin.log_map)
    found = open_logs.files()
    if found != origin.files:
        theirs = {file.name: file.sha256 for file in origin.files}
        wrong = sorted({f.name for f in {*found} ^ {*origin.files}})
        raise ConversionError(
            f"{origin.id} was made of other logs: {', '.join(wrong)} differ in digest, are missing "
            f"or are new. Expected {', '.join(theirs)}, as recipe.json lists them."
        )
    task = origin.spec.world
    episodes, tracks, *_ = _read(open_logs, origin.log_map, task, origin.clocks)
    spec = task or _spec(tracks, origin.log_map, origin.spec.task)
    if different := [path for path, *_ in differences(spec, origin.spec)]:
        raise ConversionError(
            f"{origin.id} has another {different[0]} than these logs give now: it was made with "
            "other rules of import. Install the version of swarmdata on its card."
        )
    return _stored(open_logs, out, origin, episodes)


def _checked(out: Path | str) -> Path:
    """The folder of the new dataset, before anything is read."""
    folder = Path(out).expanduser().absolute()
    check_marked(folder, MANIFEST, "dataset")
    return folder


def _opened(logs: Sequence[Path | str] | Path | str, log_map: LogMap) -> OpenLogs:
    listed = list_of("logs", logs, "the path of a log, or a list of them")
    return OpenLogs([Path(each).expanduser().absolute() for each in listed], log_map)


def _read(
    logs: OpenLogs,
    log_map: LogMap,
    task: TaskSpec | None,
    clocks: Sequence[EstimatedClock] | None = None,
) -> tuple[list[Episode], list[RobotTrack], tuple[EstimatedClock, ...], dict[str, str]]:
    """Episodes, tracks, offsets of clocks, unless known, and what was done, for the card."""
    check_task(task, log_map)
    frames = PlanarFrames(log_map.world, [*log_map.transforms, *logs.transforms()])
    reader = SignalReader(logs, frames, log_map.max_gap)
    signals, clocks = align_commands(
        [reader.robot(robot) for robot in log_map.robots], log_map, clocks
    )
    signals = with_bounds(signals)
    marker = log_map.episodes.marker
    markers = None if marker is None else reader.marker(marker)
    logs.check_all_used()
    grid = make_grid(*span_of(signals), log_map.dt)
    tracks = [make_track(each, log_map, grid) for each in signals]
    for doubt in doubts(signals, tracks, log_map.dt):
        _LOG.warning("The logs may not be what the map says: %s.", doubt)
    cuts = log_map if task is None else _within_horizon(log_map, task)
    windows, counts = find_windows(tracks, markers, grid, cuts)
    counts += reader.counts
    counts["clipped_commands"] = sum(track.n_clipped for track in tracks)
    if task is None:
        episodes, counts["absent_robot_steps"] = make_episodes(tracks, windows, log_map.states)
    else:
        episodes, left_out = score_episodes(task, log_map, signals, tracks, grid, windows)
        counts += left_out
    _check_any(episodes, tracks, log_map)
    return episodes, tracks, clocks, _notes(logs, log_map, counts)


def _check_any(episodes: Sequence[Episode], tracks: Sequence[RobotTrack], log_map: LogMap) -> None:
    """Refuses logs that give no episode."""
    if not episodes:
        raise ConversionError(
            f"no episode of at least {log_map.episodes.min_steps} steps is in the logs. "
            + "; ".join(
                f"{track.agent.name}: pose known at {np.mean(track.is_placed):.0%} of the times, "
                f"command at {np.mean(track.is_commanded):.0%}"
                for track in tracks
            )
            + f". A pose or command is unknown where samples are more than {log_map.max_gap:g} s "
            "apart (`max_gap`)."
        )


def _within_horizon(log_map: LogMap, task: TaskSpec) -> LogMap:
    """The map with episodes no longer than the task's, whose first pose is left out."""
    longest = (task.horizon + 1) * log_map.dt
    length = min(log_map.episodes.length or longest, longest)
    cuts = log_map.episodes.model_copy(update={"length": length})
    return log_map.model_copy(update={"episodes": cuts})


def _notes(logs: OpenLogs, log_map: LogMap, counts: Mapping[str, int]) -> dict[str, str]:
    """What was done to the logs, for the card."""
    notes = NUMBERED_SEEDS | {name: f"{n:,}" for name, n in sorted(counts.items()) if n}
    guessed = [robot.name for robot in log_map.robots if robot.command.differences]
    lists = {
        "actions_from_poses": guessed,
        "unread_topics": logs.unread_topics(),
        "ignored": [*log_map.ignore, *log_map.ignore_logs],
    }
    return notes | {k: _joined(names) for k, names in lists.items() if names}


def _joined(names: Sequence[str]) -> str:
    """The names, of very many only the first ones."""
    text = ", ".join(names)
    if len(text) <= MOST_NOTED:
        return text
    kept = text[:MOST_NOTED].rpartition(", ")[0]
    return f"{kept} and {len(names) - kept.count(', ') - 1} more"


def _spec(tracks: Sequence[RobotTrack], log_map: LogMap, task: str) -> RecordedSpec:
    agents = tuple(track.agent for track in tracks)
    size = sum(width(agent.observation) for agent in agents)
    commands = {
        each.name: [part.column for part in each.command.components] for each in log_map.robots
    }
    content = {
        "task": task,
        "library": "logs of robots",
        "version": IMPORT_VERSION,
        "options": {"frame": log_map.world, "commands": commands},
        "agents": agents,
        "state_size": width(POSE_SPACE) * len(agents) if log_map.states == "poses" else size,
        "state_from": log_map.states,
        "horizon": most_steps(log_map),
        "time_step": log_map.dt,
    }
    return RecordedSpec.parse(content, "the map")


def _stored(
    logs: OpenLogs, out: Path, origin: ImportedLogs, episodes: Sequence[Episode]
) -> Dataset:
    with locked(out):
        store_imported(", ".join(logs.paths), out, origin, episodes)
    return Dataset.open(out)
