"""The folder of a running recording: finished parts that survive any crash, and their assembly.

`<path>.recording/` holds `session.json`, which says what is recorded, and immutable parts. Killed
at any time, it is whole: what was not yet in a part is lost and nothing else.
"""

import re
import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from filelock import FileLock, Timeout

from swarmdata.cards.side_files import finish
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import BuildError, DatasetNotFoundError, RecipeConflictError
from swarmdata.record.episode_buffer import n_bytes
from swarmdata.specs.frozen import Frozen, differences
from swarmdata.specs.origins import Recording
from swarmdata.specs.recipe import Splits
from swarmdata.store import (
    SPLITS,
    Manifest,
    assemble,
    assign_splits,
    read_manifest,
    read_part_table,
    remove_leftovers,
    write_file,
    write_part,
)
from swarmdata.types import Episode

SESSION = "session.json"
LEAVING = ("agent_terminations", "agent_truncations", "alive")
"""Arrays that a dataset has only where agents leave an episode before its end."""

_PART = re.compile(r"part-(\d+)-policy-(\d+)")


class Session(Frozen):
    """What is recorded; the same in every process that goes on with it."""

    format_version: Literal[1] = 1
    recording: Recording
    log_probs: bool  # whether they are recorded
    masks: bool  # whether there are action masks


@dataclass(frozen=True, slots=True)
class Limits:
    """How much a part takes at most; what is not in a part is lost when the process is killed."""

    episodes: int = 50
    n_bytes: int = 32 << 20
    seconds: float = 60.0


class RecordingFolder:
    """The parts of one recording; one process at a time has it.

    Args:
        path: of the dataset to be.
        limits: of a part.

    Raises:
        BuildError: another process has it.
    """

    def __init__(self, path: Path, limits: Limits | None = None) -> None:
        self.path, self.limits = path, limits or Limits()
        self.folder = recording_folder(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._lock = FileLock(path.resolve().parent / f".{path.resolve().name}.lock")
        try:
            self._lock.acquire(timeout=0)
        except Timeout as error:
            raise BuildError(
                f"another process is recording to {path}. Wait for it, or choose another path."
            ) from error
        if self.folder.exists():
            remove_leftovers(self.folder, SESSION, _PART)
        self._waiting: dict[int, list[Episode]] = {}
        parts = self.parts()
        self._next_part = max((number for number, _ in parts), default=-1) + 1
        is_published = path.exists()  # then a killed process may have removed half of a part
        tables = [] if is_published else [read_part_table(part) for part in parts.values()]
        self._n_episodes = sum(map(len, tables))
        self._n_bytes, self._since = 0, time.monotonic()

    def session(self) -> Session | None:
        """What is recorded here, None if nothing is yet."""
        note = self.folder / SESSION
        return Session.from_file(note) if note.exists() else None

    def claim(self, session: Session) -> None:
        """Begins the recording, or checks that the one that was begun here is the same.

        Raises:
            RecipeConflictError: it is not.
        """
        there = self.session()
        if there is None:
            if self.folder.exists() and any(self.folder.iterdir()):
                raise BuildError(
                    f"{self.folder} is not the folder of an unfinished recording: it has other "
                    f"files and no {SESSION}. Move it away, or choose another path for the dataset."
                )
            self.folder.mkdir(exist_ok=True)
            write_file(self.folder / SESSION, session.to_json().encode())
            return
        if different := list(differences(there, session)):
            words = "; ".join(
                f"{path} is {old!r} there, {new!r} here" for path, old, new in different
            )
            raise RecipeConflictError(
                f"{self.folder} holds an unfinished recording of something else: {words}. Finish "
                f"it with `swarmdata record recover {self.path}`, or choose another path."
            )

    def add(self, episode: Episode) -> None:
        """Takes a finished episode; writes all that wait once they reach a limit."""
        self._waiting.setdefault(episode.policy, []).append(episode)
        self._n_episodes += 1
        self._n_bytes += n_bytes(episode)
        count = sum(map(len, self._waiting.values()))
        is_late = time.monotonic() - self._since >= self.limits.seconds
        if is_late or count >= self.limits.episodes or self._n_bytes >= self.limits.n_bytes:
            self.flush()

    def flush(self) -> None:
        """Writes the episodes that wait as parts, one for each policy."""
        for policy, episodes in sorted(self._waiting.items()):
            write_part(self.folder / f"part-{self._next_part:06d}-policy-{policy}", episodes)
        self._waiting.clear()
        self._next_part += 1
        self._n_bytes, self._since = 0, time.monotonic()

    def parts(self) -> dict[tuple[int, int], Path]:
        """Finished parts by (number, policy), in the order in which they were recorded."""
        return _parts(self.folder)

    @property
    def n_episodes(self) -> int:
        """Finished episodes, those that wait included."""
        return self._n_episodes

    def seeds(self) -> set[int]:
        """Seeds of the finished episodes, those that wait included."""
        written = {
            int(seed) for path in self.parts().values() for seed in read_part_table(path).seeds
        }
        return written | {e.seed for episodes in self._waiting.values() for e in episodes}

    def finish(self) -> Dataset:
        """Makes the dataset of all finished episodes, with its card, and removes the folder.

        Raises:
            BuildError: there is no finished episode, or none falls into the train split.
            RecipeConflictError: another dataset appeared at the path.
            DatasetError: a part is damaged.
        """
        session = self.session()
        is_published = self.path.exists()  # by a process that was killed before it had tidied up
        if session is None or not (self._waiting or self.parts() or is_published):
            raise BuildError(f"nothing was recorded to {self.path}: no episode was finished.")
        if not is_published:
            self.flush()
            _assemble(self.path, session, self.parts())
        elif read_manifest(self.path).recipe_hash != session.recording.hash():
            raise RecipeConflictError(
                f"{self.path} holds another dataset than the recording {session.recording.id} in "
                f"{self.folder}. Move one of them."
            )
        finish(self.path)
        self._remove()
        self.release()
        return Dataset.open(self.path, source="recorded")

    def _remove(self) -> None:
        """Deletes what was recorded, the note last: killed in the middle, it can be done again.

        The folder goes with it, unless somebody has put something else there.
        """
        for part in self.parts().values():
            shutil.rmtree(part)
        (self.folder / SESSION).unlink(missing_ok=True)
        if self.folder.exists() and not any(self.folder.iterdir()):
            self.folder.rmdir()

    def release(self) -> None:
        """Lets other processes have the recording; what waits is lost."""
        self._lock.release()


def recording_folder(path: Path) -> Path:
    """Where the parts of an unfinished recording are."""
    whole = path.resolve()  # `.` has no name
    return whole.parent / f"{whole.name}.recording"


def recover(path: Path | str) -> Dataset:
    """Finishes a recording whose process ended early, with the episodes that it had finished.

    Args:
        path: of the dataset to be, or its `.recording` folder.

    Raises:
        DatasetNotFoundError: there is no unfinished recording.
        BuildError: a process is still recording, or no episode was finished.
    """
    path = _unfinished(Path(path))
    parts = RecordingFolder(path)
    try:
        return parts.finish()
    finally:
        parts.release()


@dataclass(frozen=True, slots=True)
class Contents:
    """What an unfinished recording holds."""

    session: Session
    policies: tuple[tuple[str, int, int], ...]  # label, finished episodes, their joint steps


def look(path: Path | str) -> Contents:
    """Looks into an unfinished recording, which may be running.

    Args:
        path: of the dataset to be, or its `.recording` folder.

    Raises:
        DatasetNotFoundError: there is no unfinished recording.
    """
    folder = recording_folder(_unfinished(Path(path)))
    session = Session.from_file(folder / SESSION)
    counts = {source.label: [0, 0] for source in session.recording.policies}
    labels = list(counts)
    for (_, policy), part in _parts(folder).items():
        table = read_part_table(part)
        counts[labels[policy]][0] += len(table)
        counts[labels[policy]][1] += table.n_steps
    return Contents(session, tuple((label, n, steps) for label, (n, steps) in counts.items()))


def _unfinished(path: Path) -> Path:
    """The path of the dataset to be."""
    if path.suffix == ".recording":
        path = path.with_suffix("")
    folder = recording_folder(path)
    if not (folder / SESSION).exists():
        raise DatasetNotFoundError(
            f"there is no unfinished recording {folder}"
            + (f"; {path} is finished already." if path.exists() else ".")
        )
    return path


def _parts(folder: Path) -> dict[tuple[int, int], Path]:
    """Finished parts by (number, policy), in the order in which they were recorded."""
    found = {}
    for path in folder.glob("part-*"):
        if match := _PART.fullmatch(path.name):
            found[int(match[1]), int(match[2])] = path
    return dict(sorted(found.items()))


def _assemble(path: Path, session: Session, parts: dict[tuple[int, int], Path]) -> Manifest:
    """Puts the parts together: part by part, as they were recorded."""
    streams: dict[int, list[Path]] = {}
    taken: dict[int, int] = {}
    order = []
    for (_, policy), folder in parts.items():
        streams.setdefault(policy, []).append(folder)
        for _ in range(len(read_part_table(folder))):
            order.append((policy, taken.setdefault(policy, 0)))
            taken[policy] += 1
    recording = session.recording
    if SPLITS.index("train") not in assign_splits(recording, order):
        raise BuildError(
            f"{recording.id} has {len(order)} episodes, none of which falls into the train split "
            f"({_rule(recording)}). Record more; the episodes are kept."
        )
    optional = ["action_masks"] * session.masks
    optional += LEAVING if any(_agents_leave(folder) for folder in parts.values()) else ()
    return assemble(path, recipe=recording, parts=streams, order=order, optional=optional)


def _rule(recording: Recording) -> str:
    splits = recording.splits or Splits()
    return f"{splits.validation} + {splits.test} of every {splits.block} episodes are held out"


def _agents_leave(part: Path) -> bool:
    """Whether the flags of any episode say more of its agents than those of the team."""
    arrays = {name: np.load(part / f"{name}.npy", mmap_mode="r") for name in LEAVING}
    lengths = read_part_table(part).lengths
    ends = np.cumsum(lengths) - 1
    acted = np.delete(arrays["alive"], np.cumsum(lengths + 1) - 1, axis=0)  # without last states
    flags = arrays["agent_terminations"], arrays["agent_truncations"]
    alike = all((flag[ends].all(1) | ~flag[ends].any(1)).all() for flag in flags)
    early = (flags[0].any(1) | flags[1].any(1)).sum() > len(lengths)
    return not alike or bool(early) or not acted.all()
