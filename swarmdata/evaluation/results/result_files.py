"""Results as JSON files, with the provenance of the policy and the spec of the evaluation."""

import json
import math
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import ConfigDict, Field

from swarmdata.errors import FormatVersionError, OutputError, SchemaError, SpecError, check_type
from swarmdata.evaluation.runs.provenance import Provenance, file_name
from swarmdata.learn.training.run_files import CONFIG
from swarmdata.rollouts.metrics import metrics_of
from swarmdata.runtime.atomic import write_file
from swarmdata.runtime.documents import read_document
from swarmdata.runtime.output_folder import check_vacant
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins import AnySpec, Spec
from swarmdata.types import EvalResult, shortened

FORMAT = "swarmdata-evaluation"
FORMAT_VERSION = 2

_BEGIN = re.compile(rb'\s*\{\s*"format"\s*:\s*"swarmdata-evaluation"')

REQUIRED_FOREIGN_METRICS = frozenset({"return", "length"})
"""Metrics that results in environments of other libraries always have."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Result:
    """The evaluation of one policy, with its provenance and spec."""

    evaluation: EvalResult
    provenance: Provenance
    spec: Spec
    path: Path | None = None  # of its file; None: it was not read from a file

    def __repr__(self) -> str:
        """Shows means and the file, on one line."""
        where = "" if self.path is None else f", {self.path}"
        return shortened(f"Result({self.evaluation!r}{where})")

    @property
    def run_folder(self) -> Path | None:
        """The policy's run folder at the time of the evaluation; None if it has none."""
        run = self.provenance.run
        return None if run is None or self.path is None else self.path.parent / run

    @property
    def run_name(self) -> str | None:
        """The run folder as others may read it: a path below that of the file, else its name."""
        folder = self.run_folder
        if folder is None or self.path is None:
            return None
        found = Path(os.path.relpath(folder, self.path.parent))
        return folder.resolve().name if found.parts[:1] in ((), ("..",)) else found.as_posix()


Seed = Annotated[int, Field(ge=0, lt=1 << 64)]


class _Document(Frozen):
    """The content of a file: floats as their shortest exact decimals, undefined values as null."""

    model_config = ConfigDict(title="evaluation result")

    format: Literal["swarmdata-evaluation"]
    format_version: Literal[2]
    provenance: Provenance
    task: str
    spec_hash: str
    spec: AnySpec
    seeds: list[Seed]
    metrics: dict[str, list[float | None]]


def check_results_folder(folder: Path) -> None:
    """Checks that a folder is one of results, or may become one.

    Raises:
        OutputError: it has files and no result.
    """
    if not any(map(_is_result, folder.glob("*.json"))):
        check_vacant(folder, "folder of results", "result of an evaluation")


def _is_result(path: Path) -> bool:
    """Whether a file begins as results do."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return _BEGIN.match(file.read(100)) is not None


def save_result(result: Result, folder: Path | str, *, replace: bool = False) -> Path:
    """Writes a result into a folder, atomically, under the name that `file_name` gives it.

    The path of a run folder is stored relative to `folder`, so that both can be moved together.

    Args:
        result: of one policy; those of several training seeds have the same label, and each an
            index of its own.
        folder: of results; made if absent.
        replace: whether another result of this label and index may be replaced.

    Returns:
        The file.

    Raises:
        SchemaError: it is no `Result`, is incomplete, has values that its metrics cannot have, does
            not match its spec, or does not fit into JSON.
        OutputError: another file, or another result, is in its place.
    """
    advice = (
        "Pass swarmdata.Result(evaluation, swarmdata.Provenance(label=evaluation.policy), spec)."
    )
    check_type("the result", result, Result, "a Result", advice)
    folder = Path(folder)
    _check(result, "the result to save")
    evaluation, provenance = result.evaluation, with_relative_run(result.provenance, folder)
    document = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "provenance": provenance.model_dump(mode="json"),
        "task": evaluation.task,
        "spec_hash": evaluation.spec_hash,
        "spec": result.spec.model_dump(mode="json"),
        "seeds": evaluation.seeds.tolist(),
        "metrics": {  # JSON lacks NaN, and the writer refuses infinities
            name: [None if math.isnan(value) else value for value in values.tolist()]
            for name, values in evaluation.metrics.items()
        },
    }
    try:
        text = json.dumps(document, allow_nan=False, separators=(",", ":"))
    except (TypeError, ValueError) as error:
        raise SchemaError(
            f"the result of {evaluation.policy!r} cannot be written as JSON: {error}. Metrics must "
            "be finite or NaN; a configuration must be plain finite JSON values."
        ) from error
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / file_name(provenance, evaluation.spec_hash)
    if path.exists() and not _is_result(path):
        raise OutputError(
            f"{path} is in the way: it is no result of an evaluation, so it was left. Move it away."
        )
    content = f"{text}\n".encode()
    if not replace:
        _check_vacant(path, content, provenance)
    write_file(path, content)
    return path


def _check_vacant(path: Path, content: bytes, provenance: Provenance) -> None:
    """Refuses to replace another result."""
    if path.exists() and path.read_bytes() != content:
        raise OutputError(
            f"{path} holds another result of {provenance.label} number {provenance.index}. Give "
            "each policy its number, Provenance(label=..., index=k), or pass replace=True."
        )


def with_relative_run(provenance: Provenance, folder: Path) -> Provenance:
    """Makes the path of a provenance's run folder relative to `folder`."""
    if provenance.run is None or not Path(provenance.run).is_absolute():
        return provenance
    run = Path(os.path.relpath(provenance.run, folder.resolve())).as_posix()
    return provenance.model_copy(update={"run": run})


def load_result(path: Path) -> Result:
    """Reads a result that `save_result` wrote, with the same bits.

    Raises:
        FileNotFoundError: there is no such file.
        SchemaError: the file is not a complete evaluation result, or its spec has another hash in
            this version.
        FormatVersionError: a newer swarmdata wrote it.
    """
    path = Path(path)
    document = _read(path)
    provenance = document.provenance
    metrics = {  # NumPy reads None as NaN
        name: np.array(values, np.float64) for name, values in document.metrics.items()
    }
    seeds = np.array(document.seeds, np.uint64)
    evaluation = EvalResult(provenance.label, document.task, document.spec_hash, seeds, metrics)
    result = Result(evaluation, provenance, document.spec, path)
    _check(result, str(path))
    return result


def _read(path: Path) -> _Document:
    try:
        data = read_document(path)
    except SpecError as error:
        raise SchemaError(f"{path} is not JSON: {error}. Evaluate again.") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise SchemaError(f"{path} is not an evaluation result. {_what_to_name(path.parent)}")
    version = data.get("format_version")
    if isinstance(version, int) and version > FORMAT_VERSION:
        raise FormatVersionError(
            f"{path} has evaluation format {version}, this swarmdata reads up to {FORMAT_VERSION}. "
            "Upgrade swarmdata."
        )
    try:
        return _Document.parse(data, str(path))
    except SpecError as error:
        raise SchemaError(f"{error}. Evaluate again.") from error


def _what_to_name(folder: Path) -> str:
    """Where results are instead, which for the folder of a run is nowhere yet."""
    if (folder / CONFIG).is_file():
        return (
            f"{folder} is a training run: evaluate it with `swarmdata evaluate {folder} --out "
            "FOLDER`, and name that folder."
        )
    return "Name a file or a folder that `swarmdata evaluate --out` wrote."


def _check(result: Result, where: str) -> None:
    """Checks that there is one value per metric and seed, all of one policy and spec."""
    evaluation, label = result.evaluation, result.provenance.label
    if evaluation.policy != label:
        raise SchemaError(f"{where} is of {evaluation.policy!r}, its provenance of {label!r}.")
    if result.spec.hash() != evaluation.spec_hash:
        raise SchemaError(
            f"{where} was measured in spec {evaluation.spec_hash[:12]}, but holds one with hash "
            f"{result.spec.hash()[:12]} in this version. Evaluate again."
        )
    found = set(result.evaluation.metrics)
    is_foreign = result.spec.world is None
    needed = REQUIRED_FOREIGN_METRICS if is_foreign else set(metrics_of(result.evaluation.task))
    missing, unknown = sorted(needed - found), [] if is_foreign else sorted(found - needed)
    if missing or unknown:
        raise SchemaError(
            f"{where} has other metrics than this version: missing {missing}, unknown {unknown}. "
            "Evaluate again."
        )
    lengths = {name: len(values) for name, values in evaluation.metrics.items()}
    wrong = {name: n for name, n in lengths.items() if n != len(evaluation.seeds)}
    if wrong or not len(evaluation.seeds):
        raise SchemaError(
            f"{where} has {len(evaluation.seeds)} seeds but metrics of lengths {wrong or lengths}, "
            "expected one value per seed and at least one. Evaluate again."
        )
    impossible = [
        name
        for name, values in ({} if is_foreign else evaluation.metrics).items()
        if (name == "return" and not np.isfinite(values).all())
        or (name in ("success", "clean_success") and not np.isin(values, (0, 1)).all())
    ]
    if impossible or len(np.unique(evaluation.seeds)) < len(evaluation.seeds):
        raise SchemaError(
            f"{where} has impossible values of {', '.join(impossible) or 'seeds'}, expected "
            "finite returns, a success of 0 or 1, and each seed once. Evaluate again."
        )
