"""Verifies an entry: its policies act again, in a process of bounded memory and time."""

import hashlib
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarmdata import __version__
from swarmdata.errors import SchemaError, SwarmdataError
from swarmdata.evaluation.leaderboard.entry import (
    ENTRY,
    ENTRY_FOLDER,
    LEAST_SEEDS,
    N_EPISODES,
    RESULTS,
    Description,
    entry_task,
    sha256,
    too_large,
)
from swarmdata.evaluation.results.result_files import Result, load_result
from swarmdata.numerics.random import EVALUATION_BASE, block_seeds, derive
from swarmdata.registry.published import published
from swarmdata.registry.recipes import find_recipe
from swarmdata.runtime.extras import require_extra
from swarmdata.types import Bool, Double, Seeds

SECONDS = 600  # most time of a verification
GIGABYTES = 16  # most memory, addresses that are not used included
LEAST_EQUAL = 0.95  # of the episodes: rounding differs between processors, and contacts amplify it
N_REPEATED = 64  # reserved episodes that are repeated, as many as run at the same time
FARTHEST = 4.0  # standard errors that a mean may be off: claimed, or compared with fresh episodes
SAME = 1e-6  # most difference of values that count as the same, in the unit of the metric
NEGLIGIBLE = 1e-3  # smaller differences do not count, of a mean or of two policies
MOST_ALIKE = 0.5  # of the episodes that two policies may end with the same metrics
MEASURED = "measured.json"  # what the process writes

Metrics = Mapping[str, Double]
"""Values of each metric of `metrics_of` the task, [K policies, E episodes]."""


class Verdict(NamedTuple):
    """What a verification found."""

    reasons: tuple[str, ...]  # why the entry is rejected; empty: it is verified
    equal: float = 0.0  # share of the reserved episodes in which all metrics are as it says
    reserved: float = float("nan")  # mean team return on the reserved episodes, evaluated again
    fresh: float = float("nan")  # the same on fresh episodes
    results: tuple[Result, ...] = ()  # of the policies, with the metrics evaluated again

    @property
    def is_verified(self) -> bool:
        """Whether nothing speaks against the entry."""
        return not self.reasons


def verify(
    entry: Path, *, n_episodes: int = N_EPISODES, seconds: float = SECONDS, n_threads: int = 1
) -> Verdict:
    """Verifies the entry of a folder, in at most so many seconds.

    Its policies act on the reserved episodes, which must end as the entry says in every metric, and
    on as many fresh ones, whose seeds follow from the policies' hashes: a return on the reserved
    episodes that is far above that on the fresh ones was chosen on the former. Some reserved
    episodes are repeated, and must end as before. Only what was evaluated here may be published,
    `Verdict.results`: a few claimed values may differ, as rounding differs between processors.

    Raises FileNotFoundError if there is no description, and MissingExtraError for policies of ONNX
    without onnxruntime.
    """
    if links := sorted(path.name for path in entry.rglob("*") if path.is_symlink()):
        return Verdict((f"{links[0]} is a link, expected a file",))
    try:
        description = Description.from_file(entry / ENTRY)
        reasons = tuple(_wrong(entry, description))
        claimed = [] if reasons else _claimed(entry, description, n_episodes)
    except SwarmdataError as error:
        return Verdict((str(error),))
    if reasons:
        return Verdict(reasons)
    if description.is_onnx:
        require_extra("onnxruntime", "onnx", "verifying files of ONNX")
    with tempfile.TemporaryDirectory() as scratch:
        worker = f"{__package__}.act_again"
        numbers = map(str, (n_episodes, n_threads))
        command = [sys.executable, "-m", worker, str(entry), scratch, *numbers]
        try:
            done = subprocess.run(command, capture_output=True, timeout=seconds, check=False)
        except subprocess.TimeoutExpired:
            return Verdict((f"its policies took longer than {seconds:.0f} s",))
        if done.returncode:
            last = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
            return Verdict((f"its policies could not act: {last}",))
        measured = json.loads((Path(scratch) / MEASURED).read_bytes())
    reserved, fresh, repeated = (
        {metric: np.array(values) for metric, values in measured[name].items()}
        for name in ("reserved", "fresh", "repeated")
    )
    verdict = _compared(claimed, reserved, fresh, is_onnx=description.is_onnx)
    further = (*_differing(reserved, repeated), *_alike(reserved))
    return verdict._replace(reasons=(*further, *verdict.reasons))


def fresh_seeds(description: Description, n_episodes: int) -> Seeds:
    """Returns seeds that follow from the policies, in no dataset and in no block, [E]."""
    text = "".join(description.policies).encode()
    first = int.from_bytes(hashlib.sha256(text).digest()[:8])
    return derive(first, np.arange(n_episodes)) | np.uint64(EVALUATION_BASE << 1)


def _wrong(entry: Path, description: Description) -> Iterator[str]:
    """What is wrong with the dataset, the number of policies, and the files."""
    digest = published()[find_recipe(description.dataset).id].digest
    if description.digest != digest:
        yield f"its dataset has digest {description.digest[:12]}, published is {digest[:12]}"
    n_policies = len(set(description.policies))
    if n_policies < LEAST_SEEDS:
        yield f"it has {n_policies} different policies, expected at least {LEAST_SEEDS}"
    names = dict(zip(description.files, description.policies, strict=True))
    files = {path.relative_to(entry).as_posix() for path in entry.rglob("*") if not path.is_dir()}
    known = {name for name in files if re.fullmatch(rf"{RESULTS}/[^/]+\.json", name)}
    ours = {*known, *names, ENTRY, ENTRY_FOLDER.list_file}
    yield from (f"{name} does not belong there" for name in sorted(files - ours))
    if problem := too_large(entry):
        yield problem
    for name, content in names.items():
        if name not in files:
            yield f"{name} is missing"
        elif sha256(entry / name) != content:
            yield f"{name} is another file than {ENTRY} says"


def _claimed(entry: Path, description: Description, n_episodes: int) -> list[Result]:
    """The results of the policies, in their order; all must be there, of these episodes."""
    found = [load_result(path) for path in sorted((entry / RESULTS).glob("*.json"))]
    by_content = {each.provenance.content: each for each in found}
    spec, seeds = entry_task(description.dataset), block_seeds("evaluation", n_episodes)
    known = {name: getattr(description, name) for name in ("algorithm", "dataset", "digest")}
    said = {**known, "label": description.name, "view": None, "run": None}
    for index, (file, content) in enumerate(
        zip(description.files, description.policies, strict=True)
    ):
        result = by_content.get(content)
        if result is None:
            raise SchemaError(f"{file} has no result in {RESULTS}")
        for name, value in {**said, "index": index}.items():
            if (found_value := getattr(result.provenance, name)) != value:
                raise SchemaError(
                    f"the result of {file} has {name} {found_value!r}, expected {value!r} as in "
                    f"{ENTRY}"
                )
        if result.spec != spec or not np.array_equal(result.evaluation.seeds, seeds):
            raise SchemaError(
                f"the result of {file} is not of the task of {description.dataset} "
                f"on its first {n_episodes} reserved episodes"
            )
    if len(found) != len(description.policies):
        raise SchemaError(
            f"{RESULTS} has {len(found)} results of {len(description.policies)} policies, expected "
            "one of each"
        )
    return [by_content[content] for content in description.policies]


def _differing(reserved: Metrics, repeated: Metrics) -> Iterator[str]:
    """What is wrong with episodes that were repeated, [K, <= E]."""
    first = {name: reserved[name][:, : again.shape[1]] for name, again in repeated.items()}
    changed = [_changed(first[name], again, most=0.0) for name, again in repeated.items()]
    if share := float(np.any(changed, axis=0).mean()):
        yield (
            f"{share:.1%} of the episodes that its policies repeated ended otherwise: "
            "they act at random, expected the same actions each time"
        )


def _alike(reserved: Metrics) -> Iterator[str]:
    """Which policies are copies of others, whatever their files are."""
    for k, other in combinations(range(len(reserved["return"])), 2):
        pairs = ((values[k], values[other]) for values in reserved.values())
        changed = [_changed(*pair, most=NEGLIGIBLE) for pair in pairs]
        alike = 1.0 - float(np.any(changed, axis=0).mean())
        if alike > MOST_ALIKE:
            yield (
                f"its policies {k} and {other} end {alike:.0%} of the episodes with the same "
                "metrics, expected policies of different training seeds"
            )
            return


def _changed(x: Double, y: Double, *, most: float = SAME) -> Bool:
    """Where values differ by more than `most`; undefined ones (NaN) are the same."""
    return ~np.isclose(x, y, rtol=0, atol=most, equal_nan=True)


def _compared(
    claimed: list[Result], reserved: Metrics, fresh: Metrics, *, is_onnx: bool = False
) -> Verdict:
    """Compares claims with metrics on reserved episodes, and the return there with fresh ones."""
    said = {name: np.stack([r.evaluation.metrics[name] for r in claimed]) for name in reserved}
    changed = {name: _changed(said[name], again) for name, again in reserved.items()}
    equal = 1.0 - float(np.any([*changed.values()], axis=0).mean())
    reasons = []
    if equal < LEAST_EQUAL and not is_onnx:
        name = max(changed, key=lambda each: int(changed[each].sum()))
        reasons.append(
            f"{equal:.1%} of the reserved episodes ended with the metrics that it says, expected "
            f"at least {LEAST_EQUAL:.0%}; {_example(claimed, reserved, name, changed[name])}"
        )
    for reason, name, where in _altered(said, reserved, changed):
        reasons.append(f"{reason}; {_example(claimed, reserved, name, where)}")
    here, there = reserved["return"], fresh["return"]
    if here.mean() - there.mean() > FARTHEST * _error(here, there):
        reasons.append(
            f"its return is {here.mean():.3f} on the reserved episodes and {there.mean():.3f} on "
            f"fresh ones, more than {FARTHEST:.0f} standard errors less: it was chosen on the "
            "reserved ones"
        )
    means, results = (float(here.mean()), float(there.mean())), _evaluated(claimed, reserved)
    return Verdict(tuple(reasons), equal, *means, results)


def _altered(
    said: Metrics, reserved: Metrics, changed: Mapping[str, Bool]
) -> Iterator[tuple[str, str, Bool]]:
    """Yields why values are not off by rounding, their metric, and which they are, [K, E].

    Rounding shows in no metric without another path, and favors no direction: the standard error
    of a mean difference is then sqrt(sum of squares) / (K E).
    """
    is_same_path = said["path_length"] == reserved["path_length"]
    for name, where in changed.items():
        shift = _shift(said[name], reserved[name])
        if (altered := where & is_same_path).any():
            yield (
                f"its {name} differs in {altered.sum():,} of {altered.size:,} episodes in which "
                "the robots drove as it says, so that rounding is not the reason",
                name,
                altered,
            )
        elif abs(shift.sum()) > FARTHEST * np.linalg.norm(shift):
            yield (
                f"its {name} is {shift.mean():+.3g} off on average, more than {FARTHEST:.0f} "
                "standard errors",
                name,
                where,
            )


def _shift(said: Double, again: Double) -> Double:
    """Claimed minus evaluated values, [K, E], where undefined ones (NaN) count as 0."""
    change = np.nan_to_num(said) - np.nan_to_num(again)
    return np.where(np.abs(change) > NEGLIGIBLE, change, 0.0)


def _example(claimed: list[Result], reserved: Metrics, name: str, where: Bool) -> str:
    """The value of a metric that is farthest off, of those `where` it was changed, [K, E]."""
    said = np.stack([each.evaluation.metrics[name] for each in claimed])
    sizes = np.where(where, np.abs(_shift(said, reserved[name])), -1.0)
    k, e = np.unravel_index(sizes.argmax(), sizes.shape)
    provenance, seed = claimed[k].provenance, claimed[k].evaluation.seeds[e]
    return (
        f"for example, policy {provenance.index} (training seed {provenance.seed}) in the episode "
        f"of seed {seed}: {name} {said[k, e]:.6g} claimed, {reserved[name][k, e]:.6g} evaluated"
    )


def _evaluated(claimed: list[Result], reserved: Metrics) -> tuple[Result, ...]:
    """The results with the metrics that this version evaluated."""
    found = []
    for k, result in enumerate(claimed):
        metrics = {name: values[k] for name, values in reserved.items()}
        evaluation = replace(result.evaluation, metrics=metrics)
        provenance = result.provenance.model_copy(update={"code_version": __version__})
        found.append(replace(result, evaluation=evaluation, provenance=provenance))
    return tuple(found)


def _error(*evaluations: Double) -> float:
    """Standard error of the difference of two means over episodes, of returns [K, E]."""
    means = (returns.mean(0) for returns in evaluations)  # over seeds, [E]
    return float(np.sqrt(sum(each.var(ddof=1) / len(each) for each in means)))
