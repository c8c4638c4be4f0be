"""OpenLogs: the files and folders that a user named, and the tables in them."""

from collections.abc import Sequence
from pathlib import Path

from swarmdata.errors import ConversionError, DatasetNotFoundError, did_you_mean, listed
from swarmdata.interop.convert import source_digest
from swarmdata.interop.logs.bag_tables import BagContents, is_bag, read_bag
from swarmdata.interop.logs.log_tables import LogTable, is_match, read_table
from swarmdata.runtime.regular_files import check_regular
from swarmdata.specs.origins.log_map import LogMap, LogSource, StaticTransform
from swarmdata.specs.origins.log_origin import LogFile
from swarmdata.specs.plain_names import repeated


class OpenLogs:
    """The logs at some paths, by their names; each is read once, when its first signal is."""

    def __init__(self, paths: Sequence[Path], log_map: LogMap) -> None:
        self._map = log_map
        found = [log for path in paths for log in _logs_at(path)]
        kept = [log for log in found if not is_match(log.name, log_map.ignore_logs)]
        if twice := repeated(log.name for log in kept):
            raise ConversionError(
                f"several logs are named {', '.join(twice)}, but a map tells them apart by name "
                "only. Import those of each day on their own, and combine the datasets."
            )
        if not kept:
            raise ConversionError("there are no logs, expected at least one")
        for log in kept:
            if not log.is_dir():
                check_regular(log)
        self.paths = {log.name: log for log in kept}
        self._tables: dict[str, LogTable] = {}
        self._bags: dict[str, BagContents] = {}

    def table(self, log: str | None, topic: str | None, signal: str) -> LogTable:
        """The table of a log (None: the only one) or of a bag's topic; `signal` is for errors."""
        name = self._name(log, signal)
        path = self.paths[name]
        if not is_bag(path):
            if topic is not None:
                raise ConversionError(f"the {signal} has the topic {topic}, but {path} is no bag")
            if name not in self._tables:
                self._tables[name] = read_table(path, self._map.tables)
            return self._tables[name]
        if topic is None:
            raise ConversionError(f"the {signal} has no topic, which it needs in the bag {path}")
        tables = self._bag(name).tables
        if topic not in tables:
            if topic in (unread := self._bag(name).unread):
                raise ConversionError(f"{path} has no messages of {topic} (of the {signal})")
            known = {*tables, *unread}
            raise ConversionError(
                f"{path} has no topic {topic} (of the {signal}).{did_you_mean(topic, known)} "
                f"It has {listed(topic, known)}."
            )
        return tables[topic]

    def _name(self, log: str | None, signal: str) -> str:
        if log is None and len(self.paths) == 1:
            return next(iter(self.paths))
        if log not in self.paths:
            raise ConversionError(
                f"the {signal} is in {log or 'a log that the map does not name'}, expected one of "
                f"{', '.join(self.paths)}; `log` of the map names it"
            )
        return log

    def _bag(self, name: str) -> BagContents:
        if name not in self._bags:
            self._bags[name] = read_bag(self.paths[name], _topics_of(self._map))
        return self._bags[name]

    def transforms(self) -> list[StaticTransform]:
        """The static transforms of all bags."""
        bags = [name for name, path in self.paths.items() if is_bag(path)]
        return [transform for name in bags for transform in self._bag(name).transforms]

    def unread_topics(self) -> list[str]:
        """Topics of the bags that the map does not name, sorted."""
        return sorted({topic for bag in self._bags.values() for topic in bag.unread})

    def check_all_used(self) -> None:
        """Raises ConversionError if a log or a table's column is neither mapped nor ignored."""
        if idle := [name for name in self.paths if name not in {**self._tables, **self._bags}]:
            raise ConversionError(
                f"the map uses nothing of {', '.join(idle)}. Leave the log out, name it in "
                "`ignore_logs`, or map it."
            )
        for table in self._tables.values():
            if rest := table.unused(self._map.ignore):
                raise ConversionError(
                    f"{table.name} has columns that the map does not use: {', '.join(rest)}. "
                    "Keep them as `features`, or name them in `ignore`."
                )

    def files(self) -> tuple[LogFile, ...]:
        """Name and digest of each log, by name."""
        logs = sorted(self.paths.items())
        return tuple(LogFile(name=name, sha256=source_digest(path)) for name, path in logs)


def _topics_of(log_map: LogMap) -> set[str]:
    """Every topic that a map names."""
    sources: list[LogSource | None] = [log_map.episodes.marker]
    for robot in log_map.robots:
        sources += [robot, robot.pose, robot.command, robot.goal, robot.scan, robot.reward]
        sources += robot.features
    return {each.topic for each in sources if each is not None and each.topic is not None}


def _logs_at(path: Path) -> list[Path]:
    if not path.exists():
        raise DatasetNotFoundError(f"there is no log at {path}")
    if path.is_dir() and not is_bag(path):
        return sorted(each for each in path.iterdir() if each.is_file())
    return [path]
