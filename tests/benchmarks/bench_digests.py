"""One digest under every circumstance: each mini is built anew under all variants and compared.

    python -m tests.benchmarks.bench_digests [--only ID ...] [--variants NAME ...] [--steps N]

Variants are those of `tests.benchmarks.variants`. A mini takes from seconds to a minute for each.
Prints a table and ends with 1 if any digest differs, from the default's or from the published one.
"""

import argparse
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmdata.registry.published import published
from swarmdata.registry.recipes import find_recipe, shipped_recipes
from tests.benchmarks.measuring import table
from tests.benchmarks.variants import Variant, variants
from tests.support.interpreter import python

# Workers are given one thread each; here they keep those of the variant.
GENERATE = (
    "from swarmdata.runtime.engines import crew; crew.THREAD_VARIABLES = ();"
    "from swarmdata.cli.main import main; main()"
)

DIGEST = re.compile(r"digest ([0-9a-f]{64})$")


@dataclass(frozen=True)
class Built:
    digest: str  # empty if it failed
    message: str  # why it failed
    seconds: float


def command(dataset: str, folder: Path, n_workers: int, n_steps: int | None) -> list[str]:
    """Arguments of an interpreter that builds a dataset and prints its digest at the end."""
    line = ["generate", dataset, "--workers", str(n_workers), "--out", str(folder)]
    line += [] if n_steps is None else ["--steps", str(n_steps)]
    return ["-c", GENERATE, *line]


def build(
    dataset: str, variant: Variant, *, n_steps: int | None = None, typical: float = 5.0
) -> Built:
    """Builds a dataset from nothing under a variant, and removes it.

    `typical` are the seconds that a build takes, for the moments of the kills.
    """
    for part in (0.7, 0.5, 0.35, 0.25):  # of a build, before each kill: less where it was too late
        with tempfile.TemporaryDirectory() as root:
            line = command(dataset, Path(root) / "data", variant.n_workers, n_steps)
            moments = [random.uniform(0.5, 1.0) * part * typical for _ in range(variant.n_kills)]
            if all(kill(line, variant, moment) for moment in moments):
                return finish(line, variant)
    return Built("", f"it ended before it could be killed {variant.n_kills} times", 0.0)


def finish(line: Sequence[str], variant: Variant) -> Built:
    begin = time.perf_counter()
    run = python(*line, env=variant.variables(), check=False)
    seconds = time.perf_counter() - begin
    found = DIGEST.search(run.stdout.strip())
    if run.returncode or not found:
        said = run.stderr.strip().splitlines() or [f"exit code {run.returncode}"]
        return Built("", said[-1], seconds)
    return Built(found[1], "", seconds)


def kill(line: Sequence[str], variant: Variant, seconds: float) -> bool:
    """Starts a build and kills it, workers included; False if it had ended by then."""
    process = subprocess.Popen(
        [sys.executable, *line], env=variant.variables(), stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return True
    return False


def build_all(dataset: str, chosen: Sequence[Variant], n_steps: int | None) -> dict[str, Built]:
    """Builds a dataset under each variant, in order; the first is the default."""
    results: dict[str, Built] = {}
    for variant in chosen:
        typical = next(iter(results.values())).seconds if results else 5.0
        made = build(dataset, variant, n_steps=n_steps, typical=typical)
        results[variant.name] = made
        shown = made.digest[:12] or f"failed: {made.message}"
        print(f"{dataset}, {variant.name}: {made.seconds:.1f} s, {shown}", file=sys.stderr)
    return results


def compare_published(dataset: str, digest: str) -> str:
    """How a digest compares with the published one: same, DIFFERENT, STALE or none."""
    recipe = find_recipe(dataset)
    entry = published().get(recipe.id)
    if entry is None:
        return "none"
    if entry.recipe_hash != recipe.hash():
        return "STALE"
    return "same" if entry.digest == digest else "DIFFERENT"


def row(
    dataset: str, against: str, results: Mapping[str, Built], names: Sequence[str]
) -> list[str]:
    """Cells: the published digest, the default's, and whether each other one is the same."""
    default = results["default"].digest
    cells = [dataset, against, default[:12] or "FAILED"]
    for name in names[1:]:
        if name not in results:
            cells.append("—")
        elif not results[name].digest:
            cells.append("FAILED")
        else:
            cells.append("same" if results[name].digest == default else results[name].digest[:12])
    return cells


def is_clean(cells: Sequence[str]) -> bool:
    _, against, default, *others = cells
    is_same = all(cell in ("same", "—") for cell in others)
    return against in ("same", "none", "—") and default != "FAILED" and is_same


def arguments(words: Sequence[str] | None) -> argparse.Namespace:
    names = [variant.name for variant in variants()]
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--only", nargs="+", metavar="ID", help="datasets; default every mini")
    parser.add_argument("--variants", nargs="+", choices=names[1:], help="default all")
    parser.add_argument("--steps", type=int, help="fewer joint steps; nothing is published then")
    return parser.parse_args(words)


def main(words: Sequence[str] | None = None) -> int:
    options = arguments(words)
    minis = [name for name in shipped_recipes() if "-mini-v" in name]
    chosen = [find_recipe(name).id for name in options.only] if options.only else minis
    wanted = [v for v in variants() if v.name in ("default", *(options.variants or [v.name]))]
    reasons = {variant.name: variant.unavailable() for variant in wanted}
    possible = [variant for variant in wanted if not reasons[variant.name]]
    rows = []
    for dataset in chosen:
        results = build_all(dataset, possible, options.steps)
        digest = results["default"].digest
        against = "—" if options.steps else compare_published(dataset, digest)
        rows.append(row(dataset, against, results, [variant.name for variant in wanted]))
    head = ("dataset", "published", *(variant.name for variant in wanted))
    print(table(head, [tuple(cells) for cells in rows]))
    for name, reason in reasons.items():
        if reason:
            print(f"{name} is left out: {reason}.")
    if any(cells[1] == "STALE" for cells in rows):
        print("STALE: what is published was made from another recipe: swarmdata registry update.")
    return 0 if all(map(is_clean, rows)) else 1


if __name__ == "__main__":
    sys.exit(main())
