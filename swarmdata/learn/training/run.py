"""Run: a training in its folder, offline or online, from which it goes on after any interruption.

A run is a pure function of its description and of the data that this names: killed at any moment
and started again, it ends with the same curves and the same policies, bit for bit, on the same
machine.
"""

import csv
import io
import math
import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, Literal, TypeVar

import numpy as np
import torch
from pydantic import Field
from torch import Tensor
from tqdm import tqdm

from swarmdata import __version__
from swarmdata.errors import CheckpointError, DivergedError
from swarmdata.learn.training.checkpoint import load_checkpoint, part, save_checkpoint
from swarmdata.learn.training.run_files import CHECKPOINT, CONFIG, KEPT, group_folder, run_folders
from swarmdata.runtime.atomic import disk_full_explained, write_file
from swarmdata.runtime.locking import locked
from swarmdata.runtime.output_folder import check_marked
from swarmdata.runtime.own_components import own_codes
from swarmdata.specs.frozen import Frozen, describe_differences

Count = Annotated[int, Field(ge=1)]


class Description(Frozen):
    """Everything that decides the result of a run, and what it ran on: its `config.json`."""

    CLOCK: ClassVar[str]  # what counts the time of the run: its name in tables and checkpoints

    format_version: Literal[1] = 1
    algorithm: str
    config: dict[str, Any]  # of the algorithm, every default written out
    seeds: Annotated[tuple[int, ...], Field(min_length=1)]


D = TypeVar("D", bound=Description)


class Run(Generic[D]):
    """A run that is being trained: its description, its checkpoints and its tables."""

    def __init__(self, folder: Path, description: D) -> None:
        # now: the time of the last checkpoint; 0 before the first
        self.folder, self.description, self.now = folder, description, 0
        self.state: dict[str, Tensor] = {}  # of the algorithm at that time; empty before the first
        self.metadata: dict[str, Any] = {}  # of that checkpoint; empty before the first
        path = folder / CHECKPOINT
        if not path.exists():
            return
        tensors, self.metadata = load_checkpoint(path)
        hash_ = description.hash()
        if self.metadata.get("run", hash_) != hash_:  # online runs of 0.2 do not say whose they are
            raise CheckpointError(
                f"{path} does not belong to the {CONFIG} beside it. Train again in another folder."
            )
        self.state = part(tensors, "algorithm") or tensors  # online runs of 0.2 have no prefix
        self.now = int(self.metadata[description.CLOCK])

    @property
    def has_checkpoint(self) -> bool:
        return bool(self.metadata)

    def table(self, name: str, columns: Sequence[str], who: str = "seed") -> "Table":
        """Opens a table of the run, without the rows that are later than its last checkpoint."""
        last = self.now if self.has_checkpoint else -1
        return Table(self.folder / name, columns, last, (self.description.CLOCK, who))

    def log(self, table: "Table", now: int, rows: Sequence[Mapping[str, float]]) -> None:
        """Adds a row for each seed; DivergedError, and no row, if a number is not finite."""
        for seed, row in zip(self.description.seeds, rows, strict=True):
            self.check_finite(row, f"the losses of seed {seed}", now)
        for seed, row in zip(self.description.seeds, rows, strict=True):
            table.append(now, seed, row)

    def save(
        self,
        now: int,
        state: Mapping[str, Tensor],
        others: Mapping[str, Tensor] | None = None,
        *,
        keep: bool = False,
        **metadata: Any,
    ) -> None:
        """Writes a checkpoint of the algorithm's `state`, and `others` beside it, over the last.

        `now` counts updates, or joint steps of each seed, so far; `keep`: whether the checkpoint
        stays beside later ones too, `kept_path`; metadata are JSON values.
        """
        tensors = {f"algorithm.{name}": tensor for name, tensor in state.items()}
        self.check_finite(tensors, "the algorithm's tensors", now)
        metadata = {"run": self.description.hash(), self.description.CLOCK: now, **metadata}
        paths = [self.folder / CHECKPOINT]
        if keep:  # first, for what is killed in between goes on from the checkpoint before
            paths.insert(0, kept_path(self.folder, now))
            paths[0].parent.mkdir(exist_ok=True)
        for path in paths:
            save_checkpoint(path, {**tensors, **(others or {})}, metadata)

    def check_finite(self, values: Mapping[str, Any], what: str, now: int) -> None:
        """Raises DivergedError, which names them, if there are infinite or undefined numbers."""
        wrong = [f"{name} is {_shown(v)}" for name, v in values.items() if not _is_finite(v)]
        if wrong:
            more = f", and {len(wrong) - 3} more" if len(wrong) > 3 else ""
            raise DivergedError(
                f"training diverged in {self.folder}: at {now:,}, of {what}, "
                f"{', '.join(wrong[:3])}{more}. It was stopped, and the last good checkpoint is "
                "kept. Train in another folder with a smaller learning_rate or max_grad_norm, or "
                "with smaller rewards."
            )

    @contextmanager
    def bar(self, total: int, *, shown: bool, **options: Any) -> Iterator["tqdm[Any]"]:
        """A bar on standard error, if that is a terminal; Ctrl-C says how to go on."""
        hidden = None if shown else True  # None: hidden where there is no terminal
        with tqdm(total=total, initial=self.now, disable=hidden, **options) as bar:
            try:
                yield bar
            except KeyboardInterrupt:
                tqdm.write(
                    f"Stopped before the end, {self.description.CLOCK} {total:,}. To go on from "
                    f"the last checkpoint in {self.folder}, run the same command again.",
                    file=sys.stderr,
                )
                raise


@contextmanager
def claimed(folder: Path, description: D, *, shown: bool) -> Iterator[Run[D]]:
    """Yields the run of a folder, which is made this run's, or checked to be it.

    Where another process trains in the folder, this one waits for it, and says so if `shown`.

    Raises:
        OutputError: the folder has files and holds no run.
        CheckpointError: it holds another run, or is a share of the seeds of another run.
    """
    file = folder / CONFIG
    with locked(file, shown):
        check_marked(folder, CONFIG, "run folder")
        if not file.exists():
            _check_group(folder, description)
            write_file(file, description.to_json().encode())
        elif different := describe_differences(type(description).from_file(file), description):
            raise CheckpointError(
                f"{folder} holds another run, which differs in: {different}. Choose another "
                "folder, or move that one away."
            )
        yield Run(folder, description)


def _check_group(folder: Path, description: Description) -> None:
    """Checks that a folder of some seeds will differ from those of others in the seeds only."""
    if folder != group_folder(folder.parent, description.seeds):
        return
    for other in run_folders(folder.parent):
        there = type(description).from_file(other / CONFIG)
        here = description.model_copy(update={"seeds": there.seeds})
        if different := describe_differences(there, here):
            raise CheckpointError(
                f"{other} holds other seeds of the run that {folder} is to belong to, and differs "
                f"in: {different}. Give all parts the same settings, or choose another folder."
            )


def kept_path(folder: Path, update: int) -> Path:
    """The checkpoint that a run has kept of an update."""
    return folder / KEPT / f"{update}.safetensors"


def versions(*, is_compiled: bool = False, **used: str) -> dict[str, str]:
    """Versions of what the bits of a run depend on; torch.compile's kernels round differently.

    `used`: components that may be of users, as `own_codes` takes them.
    """
    compiler = {"inductor": torch.__version__} if is_compiled else {}
    others = compiler | own_codes(**used)
    return others | {
        "swarmdata": __version__,
        "torch": torch.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }


class Table:
    """A CSV file of a run: rows are appended, and dropped beyond the time a run resumes from.

    `keys` name the first two columns: what counts the time, and who the row is about.
    """

    def __init__(
        self, path: Path, columns: Sequence[str], last: int, keys: tuple[str, str]
    ) -> None:
        self.path = path
        self.columns = (*keys, *columns)
        kept: list[list[str]] = []
        if path.exists():
            with path.open(newline="", encoding="utf-8") as file:
                # a row that a crash cut short is later than the checkpoint, and is dropped
                rows = [row for row in csv.reader(file) if len(row) == len(self.columns)]
            kept = [row for row in rows if row[0].isdecimal() and int(row[0]) <= last]
        write_file(path, _csv([self.columns, *kept]))

    def append(self, now: int, who: int, values: Mapping[str, float]) -> None:
        """Adds a row; a value that was not measured stays empty."""
        cells = [format(values[c], ".6g") if c in values else "" for c in self.columns[2:]]
        with disk_full_explained(self.path), self.path.open("ab") as file:
            file.write(_csv([(str(now), str(who), *cells)]))


def _csv(rows: Sequence[Sequence[str]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def _is_finite(value: Any) -> bool:
    if isinstance(value, Tensor):
        return not value.is_floating_point() or bool(torch.isfinite(value).all())
    return math.isfinite(value)


def _shown(value: Any) -> str:
    if not isinstance(value, Tensor):
        return str(value)
    n_wrong = int((~torch.isfinite(value)).sum())
    return f"not finite in {n_wrong:,} of {value.numel():,} numbers"
