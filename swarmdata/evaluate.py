"""Evaluates a policy on the reserved seeds, and keeps the result as JSON.

The file holds what `EvalResult` holds, with floats as their shortest exact decimals and undefined
values as null, and says which version of the library measured it.
"""

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from tqdm import tqdm

from swarmdata import __version__
from swarmdata.errors import FormatVersionError, SchemaError, SpecError
from swarmdata.frozen import Frozen
from swarmdata.interfaces import Policy
from swarmdata.metrics import episode_metrics, metrics_of
from swarmdata.registry import make_env
from swarmdata.rollout import rollout
from swarmdata.seeding import evaluation_seeds
from swarmdata.spec import TaskSpec
from swarmdata.types import Double, EvalResult

FORMAT = "swarmdata-evaluation"
FORMAT_VERSION = 1


def evaluate(
    policy: Policy,
    spec: TaskSpec,
    *,
    name: str,
    n_episodes: int = 1000,
    n_copies: int = 64,
    progress: bool = True,
) -> EvalResult:
    """Runs a policy on the first `n_episodes` evaluation seeds, the same for everybody.

    Episodes are measured as they finish and not kept. The result does not depend on `n_copies`.

    Args:
        policy: acts in every copy.
        spec: the problem to solve.
        name: of the policy, for tables.
        n_episodes: how many of the reserved seeds to use.
        n_copies: how many episodes run at the same time.
        progress: whether to show a bar (on standard error, if that is a terminal).

    Raises:
        SchemaError: `n_episodes` is not positive, or the policy's actions are malformed.
    """
    if n_episodes < 1:
        raise SchemaError(f"n_episodes is {n_episodes}, expected at least 1.")
    seeds = evaluation_seeds(n_episodes)
    metrics = {metric: np.empty(n_episodes) for metric in metrics_of(spec.task)}
    env = make_env(spec, min(n_copies, n_episodes))
    hidden = None if progress else True  # None: hidden where there is no terminal
    with tqdm(total=n_episodes, desc=name, unit="episode", disable=hidden) as bar:
        for row, episode in enumerate(rollout(env, policy, seeds, progress=bar.update)):
            for metric, value in episode_metrics(episode, env.task).items():
                metrics[metric][row] = value
    return EvalResult(name, spec.task, spec.hash(), seeds, metrics)


class _Document(Frozen):
    """What the JSON file must hold."""

    format: Literal["swarmdata-evaluation"]
    format_version: Literal[1]
    code_version: str
    policy: str
    task: str
    spec_hash: str
    metadata: dict[str, Any]
    seeds: list[int]
    metrics: dict[str, list[float | None]]


def save(result: EvalResult, path: Path, *, metadata: Mapping[str, Any] | None = None) -> None:
    """Writes a result as JSON: a temporary file first, then renamed over `path`.

    Args:
        result: what to write.
        path: the `.json` file; its folder must exist.
        metadata: JSON values that say where the policy comes from, such as the dataset's digest,
            the algorithm's configuration and the training seed.

    Raises:
        SchemaError: the result is incomplete, or holds what JSON cannot hold exactly.
    """
    _check_metrics(result, "the result to save")
    document = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "code_version": __version__,
        "policy": result.policy,
        "task": result.task,
        "spec_hash": result.spec_hash,
        "metadata": dict(metadata or {}),
        "seeds": result.seeds.tolist(),
        "metrics": {name: _to_json(values) for name, values in result.metrics.items()},
    }
    try:
        text = json.dumps(document, allow_nan=False, separators=(",", ":"))
    except (TypeError, ValueError) as error:
        raise SchemaError(
            f"the result of {result.policy!r} cannot be written as JSON: {error}. Metrics must be "
            "finite or NaN; metadata must be plain finite JSON values."
        ) from error
    _write_atomically(Path(path), text + "\n")


def _write_atomically(path: Path, text: str) -> None:
    """Leaves either the old file or the whole new one, even when the power fails."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _to_json(values: Double) -> list[float | None]:
    """NaN, which JSON lacks, as None; an infinity stays and is refused by the writer."""
    return [None if math.isnan(value) else value for value in values.tolist()]


def load(path: Path) -> EvalResult:
    """Reads a result that `save` wrote, with the same bits.

    Raises:
        FileNotFoundError: there is no such file.
        SchemaError: the file is not a complete evaluation result.
        FormatVersionError: a newer swarmdata wrote it.
    """
    document = _read(Path(path))
    metrics = {
        name: np.array([math.nan if v is None else v for v in values], np.float64)
        for name, values in document.metrics.items()
    }
    result = EvalResult(
        document.policy,
        document.task,
        document.spec_hash,
        np.array(document.seeds, np.uint64),
        metrics,
    )
    _check_metrics(result, str(path))
    return result


def load_metadata(path: Path) -> dict[str, Any]:
    """Reads the metadata given to `save`, and the `code_version` that measured the result.

    Raises:
        SchemaError: as `load`.
        FormatVersionError: as `load`.
    """
    document = _read(Path(path))
    return {**document.metadata, "code_version": document.code_version}


def _read(path: Path) -> _Document:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise SchemaError(f"{path} is not JSON: {error}. Evaluate again.") from error
    version = data.get("format_version") if isinstance(data, dict) else None
    if isinstance(version, int) and version > FORMAT_VERSION:
        raise FormatVersionError(
            f"{path} has evaluation format {version}, this swarmdata reads up to {FORMAT_VERSION}. "
            "Upgrade swarmdata."
        )
    try:
        return _Document.parse(data, str(path))
    except SpecError as error:
        raise SchemaError(f"{path} is not an evaluation result: {error}") from error


def _check_metrics(result: EvalResult, where: str) -> None:
    """Raises unless there is one value per metric of this version and seed."""
    expected = set(metrics_of(result.task))
    if set(result.metrics) != expected:
        missing = sorted(expected - set(result.metrics))
        unknown = sorted(set(result.metrics) - expected)
        raise SchemaError(
            f"{where} has other metrics than this version: missing {missing}, unknown {unknown}. "
            "Evaluate again."
        )
    lengths = {name: len(values) for name, values in result.metrics.items()}
    wrong = {name: n for name, n in lengths.items() if n != len(result.seeds)}
    if wrong or not len(result.seeds):
        raise SchemaError(
            f"{where} has {len(result.seeds)} seeds but metrics of lengths {wrong or lengths}, "
            "expected one value per seed and at least one. Evaluate again."
        )


def check_comparable(results: Sequence[EvalResult]) -> None:
    """Raises unless all results are of one spec on the same seeds.

    Raises:
        SchemaError: there is no result, or two differ in spec or seeds.
    """
    if not results:
        raise SchemaError("there are no results to compare, expected at least one.")
    first = results[0]
    for other in results[1:]:
        if other.spec_hash != first.spec_hash:
            raise SchemaError(
                f"results of {first.policy!r} and {other.policy!r} are of different specs: "
                f"{first.task} {first.spec_hash[:12]} and {other.task} {other.spec_hash[:12]}. "
                "Evaluate both on one spec."
            )
        if not np.array_equal(other.seeds, first.seeds):
            raise SchemaError(
                f"results of {first.policy!r} and {other.policy!r} are on different seeds "
                f"({len(first.seeds)} and {len(other.seeds)} episodes). Evaluate both with the "
                "same n_episodes."
            )
