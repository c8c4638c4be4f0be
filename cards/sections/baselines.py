"""The section of a card with baselines: what algorithms learned from the dataset."""

import csv
import io
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files

from swarmdata.drawing import markdown
from swarmdata.rollouts.score_intervals import target_of

STUDY_FOLDERS = ("studies/coop_nav", "studies/formation")
"""Folders of the committed studies of this version of the worlds, in `cards`."""

ESTIMATES_FILE = "estimates.csv"
"""Of a study: one row per mean with its interval, as `swarmdata study` writes it."""

BASELINE_COLUMNS = (
    ("score", "score", 1.0, 1),
    ("return", "return", 1.0, 2),
    ("success", "success (%)", 100.0, 1),
    ("clean_success", "clean success (%)", 100.0, 1),
    ("robot_collisions", "robot collisions", 1.0, 2),
    ("obstacle_collisions", "obstacle collisions", 1.0, 2),
)
"""Columns: quantity in the file, header, factor to the shown unit, decimals."""

Means = Mapping[str, str]
"""A row of the file."""


@cache
def study_estimates() -> tuple[Means, ...]:
    """All estimates of the committed studies that are part of this installation."""
    found = (files("swarmdata.cards").joinpath(study, ESTIMATES_FILE) for study in STUDY_FOLDERS)
    texts = [file.read_text(encoding="utf-8") for file in found if file.is_file()]
    return tuple(row for text in texts for row in read_estimates(text))


def read_estimates(text: str) -> tuple[Means, ...]:
    """Rows of an `estimates.csv`."""
    return tuple(csv.DictReader(io.StringIO(text)))


def baselines_section(dataset_id: str, digest: str, estimates: Sequence[Means]) -> str:
    """Returns the section: one row per algorithm, or why there is none.

    Rows that learned from other rewards than those of the data are no baselines, and left out.

    Args:
        dataset_id: with its version.
        digest: of the dataset's arrays; results on other content are left out.
        estimates: of studies.
    """
    named = [row for row in estimates if row["dataset"] == dataset_id and not row["rewards"]]
    same = [row for row in named if row["digest"] == digest]
    title = "\n## Baselines\n\n"
    if not same:
        stale = " The runs of the study used other data with this id." if named else ""
        return f"{title}No study has been run on this dataset yet.{stale}\n"
    quantities_of: dict[str, dict[str, Means]] = {}
    for row in same:
        quantities_of.setdefault(row["label"], {})[row["quantity"]] = row
    best_first = sorted(
        sorted(quantities_of),
        key=lambda label: -float(quantities_of[label]["return"]["mean"]),
    )
    rows = [_row(label, quantities_of[label]) for label in best_first]
    head = (
        "algorithm",
        "family",
        "seeds",
        "updates",
        *(header for _, header, *_ in BASELINE_COLUMNS),
    )
    episodes = ", ".join(sorted({f"{int(row['episodes']):,}" for row in same}))
    target = target_of([int(row["seeds"]) for row in same])
    return (
        f"{title}{markdown.table(head, rows)}\n"
        f"The last policy of every training seed was evaluated on {episodes} reserved evaluation "
        f"seeds; values are means with 95 % intervals for {target}. "
        "Each algorithm has the same settings on all datasets, listed in the study's files; "
        "`swarmdata study` repeats the runs.\n"
    )


def _row(label: str, found: Mapping[str, Means]) -> tuple[str, ...]:
    first = found["return"]
    return (
        f"`{label}`",
        first["family"],
        first["seeds"],
        f"{int(first['updates']):,}" if first["updates"] else "–",
        *(_cell(found.get(name), factor, digits) for name, _, factor, digits in BASELINE_COLUMNS),
    )


def _cell(found: Means | None, factor: float, decimals: int) -> str:
    if found is None or not found["mean"]:
        return "–"
    value, *ends = (
        f"{factor * float(found[key]):.{decimals}f}"
        for key in ("mean", "low", "high")
        if found[key]
    )
    return f"{value} [{', '.join(ends)}]" if ends else value
