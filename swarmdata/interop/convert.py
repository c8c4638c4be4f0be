"""Converts a foreign file or folder to a dataset."""

import hashlib
import logging
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

import numpy as np

from swarmdata.audit import contradictions
from swarmdata.cards.side_files import finish
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.task_rewards import has_task_rewards
from swarmdata.errors import ConversionError, DatasetNotFoundError, UnknownNameError
from swarmdata.interop.conversion.dataset_facts import BLOCK_BYTES
from swarmdata.interop.conversion.foreign_file import check_plain
from swarmdata.interop.conversion.imported_data import ImportedData
from swarmdata.interop.conversion.user_choices import Choices, absolute_path
from swarmdata.interop.formats import Reader, all_formats, find_format
from swarmdata.runtime.atomic import is_vacant, put_in_place, sync
from swarmdata.runtime.locking import locked
from swarmdata.runtime.output_folder import check_marked
from swarmdata.specs.origins import Origin
from swarmdata.specs.origins.recording_origin import Recording
from swarmdata.specs.recipe import Splits
from swarmdata.store import SPLITS
from swarmdata.store.arrays.layout import MANIFEST
from swarmdata.store.assembly import assemble
from swarmdata.store.parts import write_scratch_part
from swarmdata.store.scratch import remove_scratch, scratch_folder
from swarmdata.types import Counts, Episode

_LOG = logging.getLogger("swarmdata")

_LARGE_ARRAYS = ("observations", "states", "actions", "rewards", "sent", "delivered")


def import_dataset(
    source: Path | str,
    out: Path | str,
    *,
    format: str,
    id: str,
    splits: Literal["kept", "new"] = "kept",
    rule: Splits | None = None,
    seed: int = 0,
    metadata: dict[str, str] | None = None,
    **answers: Any,
) -> Dataset:
    """Converts foreign data to a dataset with its card, and leaves the source unchanged.

    What appears at `out` opens, verifies and is what its description says: this is checked before.
    Memory stays below a few hundred megabytes and one episode, except where a format's module says
    otherwise. A killed conversion leaves nothing at `out`; run it again.

    Args:
        source: file or folder; it may be relative, and begin with `~`, as `out` may.
        out: where the dataset appears once it is complete.
        format: name of a format, such as `d4rl`.
        id: id of the new dataset, such as `simple_spread-omar_medium-v0`; its first part names the
            environment if the data do not.
        splits: `kept` keeps the splits of an export of this library; `new` draws new ones.
        rule: sizes of new splits.
        seed: seed of new splits.
        metadata: information for readers, such as the author, license and origin.
        answers: to questions that the data leave open, as errors ask them and as the command has
            them: `time_limit`, `episode_length`, `final`, `unfinished`, `agents`, `action_low` and
            `action_high`. Exports of this library leave none.

    Raises:
        UnknownNameError: there is no such format or answer, or `splits` is another word.
        DatasetNotFoundError: there is nothing at `source`.
        ConversionError: the data are ambiguous, damaged, do not fit together, or refer to other
            files; or there are answers for an export.
        SchemaError: a number is not finite or would be rounded, or a value is not in its space.
        MissingExtraError: the format's library is not installed.
        OutputError: something else is at `out`.
        BuildError: another dataset is at `out`, or no episode falls into the train split.
    """
    source, out = map(absolute_path, (source, out))
    _check(source, out, splits)
    choices = Choices.of(**answers)
    with _reader_of(format)(source, id.partition("-")[0], choices) as incoming:
        kept = _kept_splits(incoming, splits, choices, source)
        content = {
            "id": id,
            "spec": incoming.spec,
            "policies": incoming.policies,
            "seed": seed,
            "splits": (rule or Splits()) if kept is None else None,
            "source": format,
            "source_sha256": source_digest(source),
            "metadata": {**incoming.metadata, **(metadata or {})},
        }
        recording = Recording.parse(content, f"the recording made of {source}")
        with locked(out):
            store_imported(str(source), out, recording, incoming.episodes, kept)
    made = Dataset.open(out)
    if not has_task_rewards(made.stored):
        _LOG.warning(
            "the rewards of %s are not the terms of its task times their weights: its returns have "
            "no score, and policies that learn from it are scored by the task's rewards",
            made.id,
        )
    return made


def _check(source: Path, out: Path, splits: str) -> None:
    """Raises errors of `import_dataset` before anything is read."""
    if splits not in (known := ("kept", "new")):
        raise UnknownNameError("choice of splits", splits, known)
    check_marked(out, MANIFEST, "dataset")
    if not source.exists():
        raise DatasetNotFoundError(f"there is nothing at {source} to convert")
    check_plain(source)


def _kept_splits(
    incoming: ImportedData, splits: Literal["kept", "new"], choices: Choices, source: Path
) -> Counts | None:
    """The splits of an export of this library, which needs no choices; None to draw new ones."""
    if incoming.splits is not None and (given := choices.given()):
        raise ConversionError(
            f"{source} was exported by this library and says itself what its rows are, got "
            f"{', '.join(given)} as well. Leave these options out."
        )
    return incoming.splits if splits == "kept" else None


def _reader_of(format: str) -> Reader:
    found = find_format(format)
    if found.read is None:
        known = [each.name for each in all_formats() if each.read is not None]
        raise ConversionError(
            f"{found.title} can only be written, got format={format!r}. Formats to read: "
            f"{', '.join(known)}."
        )
    return found.read


def source_digest(path: Path) -> str:
    """SHA-256 of a file; of a folder, of the lines `<sha256>  <path>` of its files, sorted."""
    if path.is_file():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    files = sorted(each for each in path.rglob("*") if each.is_file())
    lines = [f"{source_digest(each)}  {each.relative_to(path).as_posix()}\n" for each in files]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def store_imported(
    source: str,
    out: Path,
    origin: Origin,
    episodes: Iterable[Episode],
    splits: Counts | None = None,
) -> None:
    """Writes a dataset with its card; it appears at `out` once nothing contradicts its metadata.

    The caller has locked `out`; `source` names the data in messages, and `splits` are codes of each
    episode, None to draw them as `origin` says.
    """
    if not is_vacant(out):  # either this dataset, finished before, or an error
        assemble(out, recipe=origin, parts={}, order=[])
        finish(out)
        return
    build = scratch_folder(out, "import")
    remove_scratch(build)  # left by a killed import: this process holds the lock
    build.mkdir()
    try:
        parts, order = _write_parts(build, episodes)
        if splits is not None and not (splits == SPLITS.index("train")).any():
            raise ConversionError(
                f"none of the {len(splits)} episodes of {origin.id} is in the train split, which "
                "normalization statistics need. Pass splits='new' to draw new splits."
            )
        made = build / "dataset"
        assemble(made, recipe=origin, parts=parts, order=order, splits=splits, consume=True)
        if problems := contradictions(made):
            raise ConversionError(
                f"{source} was not imported, because its rows contradict what it says they are: "
                f"{'; '.join(problems)}"
            )
        finish(made)
        put_in_place(made, out, MANIFEST)
    finally:
        remove_scratch(build)
    sync(out.parent)


def _write_parts(
    build: Path, episodes: Iterable[Episode]
) -> tuple[dict[int, list[Path]], list[tuple[int, int]]]:
    """Writes parts of about `BLOCK_BYTES`; returns them and the order, as `assemble` takes them."""
    parts: dict[int, list[Path]] = {}
    held: dict[int, list[Episode]] = {}
    counts: dict[int, int] = {}
    order, size = [], 0

    def flush() -> None:
        for policy, group in held.items():
            folders = parts.setdefault(policy, [])
            folders.append(build / f"policy-{policy}-part-{len(folders):05d}")
            write_scratch_part(folders[-1], group)
        held.clear()

    for episode in episodes:
        held.setdefault(episode.policy, []).append(episode)
        order.append((episode.policy, counts.get(episode.policy, 0)))
        counts[episode.policy] = order[-1][1] + 1
        names = (*_LARGE_ARRAYS, *episode.optional)
        size += sum(np.asarray(getattr(episode, name)).nbytes for name in names)
        if size >= BLOCK_BYTES:
            flush()
            size = 0
    flush()
    return parts, order
