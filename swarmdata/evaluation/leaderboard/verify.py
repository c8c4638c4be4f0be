"""Verifies an entry: its policies act again, in a process of bounded memory and time."""

import hashlib
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarmdata.errors import SchemaError, SwarmdataError
from swarmdata.evaluation.leaderboard.entry import (
    ENTRY,
    LARGEST,
    LEAST_SEEDS,
    N_EPISODES,
    RESULTS,
    Description,
    sha256,
)
from swarmdata.evaluation.results.result_files import Result, load_result
from swarmdata.numerics.random import EVALUATION_BASE, block_seeds, derive
from swarmdata.registry.published import published
from swarmdata.registry.recipes import find_recipe
from swarmdata.runtime.extras import require_extra
from swarmdata.types import Double, Seeds

SECONDS = 600  # most time of a verification
GIGABYTES = 16  # most memory, addresses that are not used included
LEAST_EQUAL = 0.95  # of the episodes: rounding differs between processors, and contacts amplify it
N_REPEATED = 64  # reserved episodes that are repeated, as many as run at the same time
FARTHEST = 4.0  # standard errors by which the return may be higher on the reserved episodes
ONNX_MARGIN = 2.0  # standard errors allowed for files of ONNX, whose runtimes round differently


class Verdict(NamedTuple):
    """What a verification found."""

    reasons: tuple[str, ...]  # why the entry is rejected; empty: it is verified
    equal: float = 0.0  # share of the reserved episodes that ended with the return that it says
    reserved: float = float("nan")  # mean team return on the reserved episodes, evaluated again
    fresh: float = float("nan")  # the same on fresh episodes

    @property
    def is_verified(self) -> bool:
        """Whether nothing speaks against the entry."""
        return not self.reasons


def verify(
    entry: Path, *, n_episodes: int = N_EPISODES, seconds: float = SECONDS, n_threads: int = 1
) -> Verdict:
    """Verifies an entry.

    Its policies act on the reserved episodes, which must end as the entry says, and on as many
    fresh ones, whose seeds follow from the policies' hashes: a return on the reserved episodes that
    is far above that on the fresh ones was chosen on the former. Some reserved episodes are
    repeated, and must end as before.

    Args:
        entry: its folder.
        n_episodes: reserved episodes that it must have results of, and fresh ones.
        seconds: most time.
        n_threads: threads that step the worlds; the verdict does not depend on it.

    Raises:
        FileNotFoundError: the folder has no description.
        MissingExtraError: the policies are files of ONNX, and onnxruntime is not installed.
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
        measured = json.loads((Path(scratch) / "returns.json").read_bytes())
    blocks = ("reserved", "fresh", "repeated")
    reserved, fresh, repeated = (np.array(measured[name]) for name in blocks)
    verdict = _compared(claimed, reserved, fresh, is_onnx=description.is_onnx)
    return verdict._replace(reasons=(*_differing(reserved, repeated), *verdict.reasons))


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
    yield from (f"{name} does not belong there" for name in files - known - {*names, ENTRY})
    if (size := sum((entry / name).stat().st_size for name in files)) > LARGEST:
        yield f"it has {size / 1e6:.1f} MB, expected at most {LARGEST / 1e6:.0f}"
    for name, content in names.items():
        if name not in files:
            yield f"{name} is missing"
        elif sha256(entry / name) != content:
            yield f"{name} is another file than {ENTRY} says"


def _claimed(entry: Path, description: Description, n_episodes: int) -> list[Result]:
    """The results of the policies, in their order; all must be there, of these episodes."""
    found = [load_result(path) for path in sorted((entry / RESULTS).glob("*.json"))]
    by_content = {each.provenance.content: each for each in found}
    spec, seeds = find_recipe(description.dataset).spec, block_seeds("evaluation", n_episodes)
    for file, content in zip(description.files, description.policies, strict=True):
        result = by_content.get(content)
        if result is None:
            raise SchemaError(f"{file} has no result in {RESULTS}")
        if result.spec != spec or not np.array_equal(result.evaluation.seeds, seeds):
            raise SchemaError(
                f"the result of {file} is not of the task of {description.dataset} "
                f"on its first {n_episodes} reserved episodes"
            )
    return [by_content[content] for content in description.policies]


def _differing(reserved: Double, repeated: Double) -> Iterator[str]:
    """What is wrong with returns of episodes that were repeated, [K, <= E]."""
    if share := float((reserved[:, : repeated.shape[1]] != repeated).mean()):
        yield (
            f"{share:.1%} of the episodes that its policies repeated ended with another return: "
            "they act at random, expected the same actions each time"
        )


def _compared(
    claimed: list[Result], reserved: Double, fresh: Double, *, is_onnx: bool = False
) -> Verdict:
    """Compares claimed returns with those on reserved and on fresh episodes, both [K, E]."""
    said = np.stack([each.evaluation.metrics["return"] for each in claimed])
    equal = float(np.isclose(said, reserved, rtol=0, atol=1e-6).mean())
    reasons = []
    off = abs(said.mean() - reserved.mean())
    is_near = is_onnx and off <= ONNX_MARGIN * _error(reserved, reserved)
    if equal < LEAST_EQUAL and not is_near:
        reasons.append(
            f"{equal:.1%} of the reserved episodes ended with the return that it says, expected "
            f"at least {LEAST_EQUAL:.0%}; its mean is {said.mean():.3f}, evaluated again "
            f"{reserved.mean():.3f}"
        )
    if reserved.mean() - fresh.mean() > FARTHEST * _error(reserved, fresh):
        reasons.append(
            f"its return is {reserved.mean():.3f} on the reserved episodes and "
            f"{fresh.mean():.3f} on fresh ones, more than {FARTHEST:.0f} standard errors less: "
            "it was chosen on the reserved ones"
        )
    return Verdict(tuple(reasons), equal, float(reserved.mean()), float(fresh.mean()))


def _error(*evaluations: Double) -> float:
    """Standard error of the difference of two means over episodes, of returns [K, E]."""
    means = (returns.mean(0) for returns in evaluations)  # over seeds, [E]
    return float(np.sqrt(sum(each.var(ddof=1) / len(each) for each in means)))
