"""The folder of an unfinished recording, `<path>.recording/`, and the dataset made of it."""

import re
import shutil
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from swarmdata.cards.side_files import finish
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import BuildError, DatasetNotFoundError, RecipeConflictError
from swarmdata.record.episode_buffer import episode_bytes
from swarmdata.runtime.atomic import is_vacant
from swarmdata.runtime.locking import beside, locked
from swarmdata.specs.frozen import Frozen, differences
from swarmdata.specs.origins.recording_origin import Recording
from swarmdata.specs.recipe import Splits
from swarmdata.store import SPLITS, Manifest, read_manifest, remove_leftovers, write_file
from swarmdata.store.arrays.layout import LEAVING_ARRAYS
from swarmdata.store.assembly import assemble
from swarmdata.store.parts import read_part_table, write_part
from swarmdata.store.split_rule import assign_splits
from swarmdata.store.table import n_steps_of
from swarmdata.types import Episode

SESSION_FILE = "session.json"

_PART_NAME = re.compile(r"part-(\d+)-policy-(\d+)")


class Session(Frozen):
    """Description of a recording; the same in every process that continues it."""

    format_version: Literal[1] = 1
    recording: Recording
    log_probs: bool  # whether log-probabilities are recorded
    masks: bool  # whether there are action masks


@dataclass(frozen=True, slots=True)
class Limits:
    """When finished episodes are written as a part; a killed process loses those not written."""

    episodes: int | None = None
    """That are not written yet; None: 50, or a sixteenth of those that are if that is more, so that
    a recording of many short episodes has few parts."""
    n_bytes: int = 32 << 20  # that these episodes take in memory
    seconds: float = 60.0  # since the last part was written


class RecordingFolder:
    """The parts of one recording; BuildError if another process holds the lock."""

    def __init__(self, path: Path, limits: Limits | None = None) -> None:
        self.path, self._limits = path, limits or Limits()
        self.folder = unfinished_folder(path)
        self._lock = ExitStack()
        self._lock.enter_context(locked(path, patience=0.0))
        if self.folder.exists():
            remove_leftovers(self.folder, SESSION_FILE, _PART_NAME)
        self._unwritten: dict[int, list[Episode]] = {}
        parts = _parts(self.folder)
        self._next_part = max((number for _, number in parts), default=-1) + 1
        is_published = not is_vacant(path)  # then a killed process may have removed half of a part
        tables = [] if is_published else [read_part_table(part) for part in parts.values()]
        self.n_episodes = sum(map(len, tables))  # finished ones, whether they are written or not
        self._n_bytes, self._since = 0, time.monotonic()

    def session(self) -> Session | None:
        """The description of the recording, None before it began."""
        note = self.folder / SESSION_FILE
        return Session.from_file(note) if note.exists() else None

    def claim(self, session: Session) -> None:
        """Begins the recording, or continues one with the same description; else it is refused."""
        stored = self.session()
        if stored is None:
            if self.folder.exists() and any(self.folder.iterdir()):
                raise BuildError(
                    f"{self.folder} is not the folder of an unfinished recording: it has other "
                    f"files and no {SESSION_FILE}. Move it away, or choose another path for the "
                    "dataset."
                )
            self.folder.mkdir(exist_ok=True)
            write_file(self.folder / SESSION_FILE, session.to_json().encode())
            return
        if different := list(differences(stored, session)):
            words = "; ".join(
                f"{path} is {old!r} there, {new!r} here" for path, old, new in different
            )
            raise RecipeConflictError(
                f"{self.folder} holds an unfinished recording of something else: {words}. Finish "
                f"it with `swarmdata record recover {self.path}`, or choose another path."
            )

    def add(self, episode: Episode) -> None:
        """Adds a finished episode, and writes all unwritten ones when they reach a limit."""
        self._unwritten.setdefault(episode.policy, []).append(episode)
        self.n_episodes += 1
        self._n_bytes += episode_bytes(episode)
        n_waiting = sum(map(len, self._unwritten.values()))
        most = self._limits.episodes
        if most is None:
            most = max(50, (self.n_episodes - n_waiting) // 16)
        is_late = time.monotonic() - self._since >= self._limits.seconds
        if n_waiting >= most or self._n_bytes >= self._limits.n_bytes or is_late:
            self.flush()

    def flush(self) -> None:
        """Writes the unwritten episodes as parts, one for each policy."""
        for policy, episodes in sorted(self._unwritten.items()):
            write_part(self.folder / f"part-{self._next_part:06d}-policy-{policy}", episodes)
            del self._unwritten[policy]
            self._next_part += 1  # the next one has other episodes, also if another policy's fail
        self._n_bytes, self._since = 0, time.monotonic()

    def seeds(self) -> set[int]:
        """Seeds of the episodes that are written."""
        parts = _parts(self.folder).values()
        return {seed for part in parts for seed in read_part_table(part)["seed"].tolist()}

    def finish(self) -> Dataset:
        """Makes the dataset of all finished episodes, with its card, and removes the folder."""
        session = self.session()
        is_published = not is_vacant(self.path)  # by a process that was killed before it cleaned up
        if session is None or not (self._unwritten or _parts(self.folder) or is_published):
            raise BuildError(f"nothing was recorded to {self.path}: no episode was finished.")
        if not is_published:
            self.flush()
            _assemble(self.path, session, _parts(self.folder))
        elif read_manifest(self.path).recipe_hash != session.recording.hash():
            raise RecipeConflictError(
                f"{self.path} holds another dataset than the recording {session.recording.id} in "
                f"{self.folder}. Move one of the two."
            )
        finish(self.path)
        for part in _parts(self.folder).values():
            shutil.rmtree(part)
        # after the parts, so that a killed removal can be repeated
        (self.folder / SESSION_FILE).unlink(missing_ok=True)
        if self.folder.exists() and not any(self.folder.iterdir()):
            self.folder.rmdir()
        self.release()
        return Dataset.open(self.path, source="recorded")

    def release(self) -> None:
        """Unlocks the recording for other processes; unwritten episodes are lost."""
        self._lock.close()


def unfinished_folder(path: Path) -> Path:
    """The folder with the parts of an unfinished recording."""
    resolved = path.resolve()  # `.` has no name
    return beside(resolved) / f"{resolved.name}.recording"


def recover(path: Path | str) -> Dataset:
    """Makes a dataset of the finished episodes of a recording whose process ended early.

    Args:
        path: where the dataset will be, or its `.recording` folder.

    Raises:
        DatasetNotFoundError: there is no unfinished recording.
        BuildError: a process is still recording, or no episode was finished.
    """
    folder = RecordingFolder(_dataset_path(Path(path)))
    try:
        return folder.finish()
    finally:
        folder.release()


@dataclass(frozen=True, slots=True)
class RecordingContents:
    """Contents of an unfinished recording."""

    session: Session
    policies: tuple[tuple[str, int, int], ...]  # label, finished episodes, their joint steps


def inspect_recording(path: Path | str) -> RecordingContents:
    """Counts the episodes of an unfinished recording, which may be running."""
    folder = unfinished_folder(_dataset_path(Path(path)))
    session = Session.from_file(folder / SESSION_FILE)
    counts = {source.label: [0, 0] for source in session.recording.policies}
    labels = list(counts)
    for (policy, _), part in _parts(folder).items():
        table = read_part_table(part)
        counts[labels[policy]][0] += len(table)
        counts[labels[policy]][1] += n_steps_of(table)
    return RecordingContents(
        session, tuple((label, n, steps) for label, (n, steps) in counts.items())
    )


def _dataset_path(path: Path) -> Path:
    if path.suffix == ".recording":
        path = path.with_suffix("")
    folder = unfinished_folder(path)
    if not (folder / SESSION_FILE).exists():
        raise DatasetNotFoundError(
            f"there is no unfinished recording {folder}"
            + (f"; {path} is finished already." if not is_vacant(path) else ".")
        )
    return path


def _parts(folder: Path) -> dict[tuple[int, int], Path]:
    """Finished parts by (policy, number): those of each policy in the order of recording."""
    found = {}
    for path in folder.glob("part-*"):
        if match := _PART_NAME.fullmatch(path.name):
            found[int(match[2]), int(match[1])] = path
    return dict(sorted(found.items()))


def _assemble(path: Path, session: Session, parts: dict[tuple[int, int], Path]) -> Manifest:
    """Makes the dataset of the parts, whenever these were written."""
    streams: dict[int, list[Path]] = {}
    for (policy, _), folder in parts.items():
        streams.setdefault(policy, []).append(folder)
    counts = {n: sum(map(len, map(read_part_table, each))) for n, each in streams.items()}
    order = [(policy, k) for policy, count in counts.items() for k in range(count)]
    recording = session.recording
    if SPLITS.index("train") not in assign_splits(recording, order):
        splits = recording.splits or Splits()
        raise BuildError(
            f"{recording.id} has {len(order)} episodes, none of which falls into the train split "
            f"({splits.validation} + {splits.test} of every {splits.block} episodes are held out). "
            "Record more; the episodes are kept."
        )
    optional = ["action_masks"] * session.masks
    optional += ["reward_terms"] * (recording.spec.world is not None)
    optional += LEAVING_ARRAYS if any(_agents_leave(folder) for folder in parts.values()) else ()
    return assemble(
        path, recipe=recording, parts=streams, order=order, optional=optional, progress=True
    )


def _agents_leave(part: Path) -> bool:
    """Whether some agent ends before its team, or otherwise than its team."""
    arrays = {name: np.load(part / f"{name}.npy", mmap_mode="r") for name in LEAVING_ARRAYS}
    lengths = read_part_table(part)["length"]
    ends = np.cumsum(lengths) - 1
    acted = np.delete(arrays["alive"], np.cumsum(lengths + 1) - 1, axis=0)  # without last states
    flags = arrays["agent_terminations"], arrays["agent_truncations"]
    alike = all((flag[ends].all(1) | ~flag[ends].any(1)).all() for flag in flags)
    early = (flags[0].any(1) | flags[1].any(1)).sum() > len(lengths)
    return not alike or bool(early) or not acted.all()
