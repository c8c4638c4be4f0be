"""Fits the thresholds of `train auto` to published scores, and prints what it would have lost.

    python -m tests.benchmarks.fit_auto             thresholds, and tables of regrets
    python -m tests.benchmarks.fit_auto --measure   builds and measures new datasets first

Scores are those of the study `regimes`, means of 5 seeds; statistics are of train splits of a fifth
of its datasets, in `auto_statistics.csv`. A regret is the score of the best algorithm, ablations
apart, less that of the chosen one. The last table is of datasets that are not part of the fit.
"""

import csv
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import pairwise, product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from swarmdata.building.build import build
from swarmdata.datasets.dataset import Dataset
from swarmdata.drawing import markdown
from swarmdata.evaluation.runs.algorithm_choice import (
    CANDIDATES,
    MATD3_COMMON,
    STATISTICS,
    THRESHOLDS,
    EpisodeStatistics,
    Threshold,
    choose_algorithm,
    matd3_obstacle,
)
from swarmdata.hub.catalog.catalog import load
from swarmdata.registry.recipes import find_recipe, is_dataset
from swarmdata.specs.recipe import Recipe

STUDIES = Path(__file__).parents[2] / "cards/studies"
FITTED_STUDY = STUDIES / "regimes"
LATER_STUDIES = tuple(STUDIES / name for name in ("strict", "robotarium", "swap", "teams"))
MEASURED = Path(__file__).parent / "auto_statistics.csv"
FAMILY_OF_ABLATIONS = "ablations"

CLONES = ("bc", "filtered_bc")
"""Where the best episodes are by the same policies as the rest, and by others."""

POOR = ("iql", "filtered_bc")
"""Where no policy solves most episodes, robots have returns of their own, and share them.

`auto` takes `maddpg_bc` in place of `iql` where a contact ends the episode, and `matd3` where the
best episodes are by other policies than the rest. Both were found on these datasets, too;
thresholds are fitted as if it took `iql` there.
"""

EVERYWHERE = ("bc", "filtered_bc", "iql", "maddpg_bc")
"""Of `CANDIDATES`: those that were trained on all datasets."""

FITTED = ("bc", "filtered_bc", "iql")
"""What thresholds are fitted to."""

N_STEPS = 200_000
"""Joint steps that statistics are measured on: a fifth of the published datasets."""

TOLERANCE = 5.0
"""Points of the score: candidates that are no further behind the best one count as good as it."""

Thresholds = dict[str, Threshold]
Errors = dict[Threshold, int]


@dataclass(frozen=True)
class Row:
    dataset: str  # id without version
    scores: Mapping[str, float]  # by label of the study, without ablations
    statistics: EpisodeStatistics

    @property
    def task(self) -> str:
        return self.dataset.partition("-")[0]

    @property
    def contact_ends(self) -> bool:
        return "-strict-" in self.dataset

    @property
    def obstacle(self) -> str | None:
        size = re.search(r"-n(\d+)-", self.dataset)
        return matd3_obstacle(1_000_000, 4 if size is None else int(size[1]))

    def regret(self, algorithm: str) -> float:
        return max(self.scores.values()) - self.scores[algorithm]

    def is_worse(self, algorithm: str) -> bool:
        """Whether one of the fitted algorithms is clearly worse than the best of them."""
        best = max(self.scores[each] for each in FITTED)
        return self.scores[algorithm] < best - TOLERANCE


def read_scores(study: Path) -> dict[str, dict[str, float]]:
    """Scores by dataset and label, of full datasets with the recorded rewards."""
    found: dict[str, dict[str, float]] = {}
    with (study / "estimates.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if row["quantity"] == "score" and row["family"] != FAMILY_OF_ABLATIONS:
                name = row["dataset"].removesuffix("-v1")
                found.setdefault(name, {})[row["label"]] = float(row["mean"])
    return {name: scores for name, scores in found.items() if {*EVERYWHERE} <= scores.keys()}


def read_rows(study: Path = FITTED_STUDY) -> list[Row]:
    """The datasets that these candidates were trained on, with their statistics."""
    measured = read_measured()
    return [Row(name, scores, measured[name]) for name, scores in read_scores(study).items()]


def read_later_rows() -> list[Row]:
    return [row for study in LATER_STUDIES for row in read_rows(study)]


def read_measured() -> dict[str, EpisodeStatistics]:
    with MEASURED.open(encoding="utf-8") as file:
        rows = {row.pop("dataset"): row for row in csv.DictReader(file)}
    return {
        name: EpisodeStatistics(**{k: float(v) for k, v in row.items()})
        for name, row in rows.items()
    }


def recipe_of(name: str) -> Recipe:
    """The recipe of a shipped dataset, or of one that was generated on this machine."""
    found = find_recipe(name) if is_dataset(name) else load(name).recipe.recipe
    assert isinstance(found, Recipe)
    return found


def measure() -> None:
    """Adds the statistics of train splits of `N_STEPS` joint steps of new datasets, built here."""
    known = read_measured()
    with MEASURED.open("a", encoding="utf-8", newline="") as file:
        columns = ["dataset", *(field.name for field in fields(EpisodeStatistics))]
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        for name in (
            each for study in (FITTED_STUDY, *LATER_STUDIES) for each in read_scores(study)
        ):
            if name in known:
                continue
            recipe = Recipe.parse({**recipe_of(name).model_dump(), "n_steps": N_STEPS})
            with TemporaryDirectory() as folder:
                dataset = Dataset.open(build(recipe, Path(folder) / name))
                found = EpisodeStatistics.of(dataset.split("train"))
            writer.writerow({"dataset": name} | {k: f"{v:.4f}" for k, v in asdict(found).items()})


def gaps(rows: Iterable[Row], name: str) -> list[Threshold]:
    """The places between values of a statistic where a threshold may lie, and one above them."""
    values = sorted({getattr(row.statistics, name) for row in rows})
    return [Threshold(*ends) for ends in pairwise([*values, np.inf])] or [Threshold(0.0, np.inf)]


def fit(rows: Iterable[Row]) -> Thresholds:
    """Thresholds with which the fewest datasets get an algorithm that is clearly worse.

    Of those that are equally good, the ones with the widest gaps around them: they are the least
    likely to divide other datasets wrongly. A gap is between datasets that are asked the question.
    """
    every = list(rows)

    def is_above(row: Row, threshold: Threshold, name: str) -> bool:
        return bool(getattr(row.statistics, name) >= threshold.middle)

    def errors(asked: Sequence[Row], name: str, answers: tuple[str, str]) -> Errors:
        """How many of the rows get a clearly worse algorithm, by threshold."""
        return {
            threshold: sum(row.is_worse(answers[is_above(row, threshold, name)]) for row in asked)
            for threshold in gaps(asked, name)
        }

    def candidates() -> Iterator[tuple[int, float, tuple[Threshold, ...]]]:
        for success in gaps(every, "best_success"):
            cloned = [row for row in every if is_above(row, success, "best_success")]
            poor = [row for row in every if not is_above(row, success, "best_success")]
            shifts = errors(cloned, "best_shift", CLONES)
            commons = errors(poor, "common_reward", POOR)
            for shift, common in product(shifts, commons):
                found = success, shift, common
                yield shifts[shift] + commons[common], -sum(map(width, found)), found

    return dict(zip(STATISTICS, min(candidates())[2], strict=True))


def fit_matd3(rows: Iterable[Row], thresholds: Thresholds) -> float:
    """The largest common reward at which `matd3` is chosen and not clearly worse than `iql`."""
    return max(
        row.statistics.common_reward
        for row in rows
        if chosen(row, thresholds, 1.0) == "matd3"
        and row.scores["matd3"] >= row.scores["iql"] - TOLERANCE
    )


def rounded(threshold: Threshold) -> Threshold:
    """The ends with two digits, so that no measured dataset is between them."""
    low, high = (round(100 * end, 6) for end in threshold)
    return Threshold(math.ceil(low) / 100, math.floor(high) / 100)


def width(threshold: Threshold) -> float:
    """Of the gap; nothing where all datasets are below."""
    return 0.0 if np.isinf(threshold.above) else threshold.above - threshold.below


def chosen(
    row: Row, thresholds: Thresholds = THRESHOLDS, matd3_common: float = MATD3_COMMON
) -> str:
    """What `auto` chooses."""
    return choose_algorithm(
        row.statistics, thresholds, matd3_common,
        contact_ends=row.contact_ends, obstacle=row.obstacle,
    ).algorithm  # fmt: skip


def left_out(rows: Sequence[Row], key: Callable[[Row], str]) -> list[str]:
    """What is chosen for each dataset by what is fitted to those with another key."""
    others = {each: [row for row in rows if key(row) != each] for each in set(map(key, rows))}
    fitted = {each: (found := fit(part), fit_matd3(part, found)) for each, part in others.items()}
    return [chosen(row, *fitted[key(row)]) for row in rows]


def choices(rows: Sequence[Row]) -> dict[str, list[str]]:
    """The algorithm of each dataset, by way of choosing."""
    return {
        "auto, leave one dataset out": left_out(rows, lambda row: row.dataset),
        "auto, leave one task out": left_out(rows, lambda row: row.task),
        **{f"always `{name}`": [name] * len(rows) for name in EVERYWHERE},
        "best of the five": [
            min(row.scores.keys() & {*CANDIDATES}, key=row.regret) for row in rows
        ],
    }


def regrets(rows: Sequence[Row], picked: Sequence[str]) -> list[float]:
    return [row.regret(name) for row, name in zip(rows, picked, strict=True)]


def report(rows: Sequence[Row], found: Mapping[str, Sequence[str]]) -> str:
    """The table of ways, as `choices` finds them, and that of datasets, as Markdown."""
    ways = []
    for way, picked in found.items():
        lost = regrets(rows, picked)
        within = sum(each <= 3 for each in lost)
        ways.append([way, f"{np.mean(lost):.1f}", f"{max(lost):.1f}", str(within)])
    head = ["choice", "mean regret", "worst", f"within 3, of {len(rows)}"]
    picked = found["auto, leave one dataset out"]
    tables = (markdown.table(head, ways, is_numeric=True), table_of_datasets(rows, picked))
    return "\n".join(tables)


def table_of_datasets(rows: Sequence[Row], picked: Sequence[str]) -> str:
    """A row for each dataset with the algorithm that is picked, as Markdown."""
    lines = [
        [
            f"`{row.dataset}`",
            *(f"{value:.2f}" for value in asdict(row.statistics).values()),
            *(f"{row.scores[each]:.1f}" if each in row.scores else "" for each in CANDIDATES),
            f"`{name}`",
            f"{row.regret(name):.1f}",
        ]
        for row, name in zip(rows, picked, strict=True)
    ]
    columns = ["dataset", "common reward", "best success", "best shift"]
    columns += [*(f"`{each}`" for each in CANDIDATES), "auto", "regret"]
    return markdown.table(columns, lines)


if __name__ == "__main__":
    if sys.argv[1:] == ["--measure"]:
        measure()
    datasets = read_rows()
    for name, (low, high) in ((name, rounded(each)) for name, each in fit(datasets).items()):
        print(f'    "{name}": Threshold({low:.2f}, {high:.2f}),')
    print(f"\n{report(datasets, choices(datasets))}")
    print(f"\nMATD3_COMMON = {math.ceil(100 * fit_matd3(datasets, fit(datasets))) / 100:.2f}")
    later = read_later_rows()
    print(f"\n{table_of_datasets(later, list(map(chosen, later)))}")
