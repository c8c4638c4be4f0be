"""The section of a card with baselines: what algorithms learned from the dataset."""

import csv
import io
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files

import numpy as np

from swarmdata.drawing import markdown
from swarmdata.rollouts.score_statistics import bootstrap, iqm

STUDY_FOLDERS = ("studies/coop_nav", "studies/formation")
"""Folders of the committed studies of this version of the worlds, in `cards`."""

RESULTS_FILE = "results.csv"
"""Of a study: one row per run, as `swarmdata study` writes it."""

BASELINE_COLUMNS = (
    ("score", "score", 1.0, 1),
    ("return", "return", 1.0, 2),
    ("success", "success (%)", 100.0, 1),
    ("clean_success", "clean success (%)", 100.0, 1),
    ("robot_collisions", "robot collisions", 1.0, 2),
    ("obstacle_collisions", "obstacle collisions", 1.0, 2),
)
"""Columns: name in the file, header, factor to the shown unit, decimals."""

Run = Mapping[str, str]


@cache
def study_runs() -> tuple[Run, ...]:
    """All runs of the committed studies that are part of this installation."""
    found = (files("swarmdata.cards").joinpath(study, RESULTS_FILE) for study in STUDY_FOLDERS)
    texts = [file.read_text(encoding="utf-8") for file in found if file.is_file()]
    return tuple(run for text in texts for run in read_runs(text))


def read_runs(text: str) -> tuple[Run, ...]:
    """Rows of a `results.csv`."""
    return tuple(csv.DictReader(io.StringIO(text)))


def baselines_section(dataset_id: str, digest: str, runs: Sequence[Run]) -> str:
    """Returns the section: one row per algorithm, or why there is none.

    Args:
        dataset_id: with its version.
        digest: of the dataset's arrays; runs on other content are left out.
        runs: of studies.
    """
    named = [run for run in runs if run["dataset"] == dataset_id]
    same = [run for run in named if run["digest"] == digest]
    title = "\n## Baselines\n\n"
    if not same:
        stale = " The runs of the study used other data with this id." if named else ""
        return f"{title}No study has been run on this dataset yet.{stale}\n"
    runs_of: dict[str, list[Run]] = {}
    for run in same:
        runs_of.setdefault(run["label"], []).append(run)
    best_first = sorted(
        sorted(runs_of),
        key=lambda label: -np.mean([float(run["return"]) for run in runs_of[label]]),
    )
    rows = [_row(label, runs_of[label]) for label in best_first]
    head = (
        "algorithm",
        "family",
        "seeds",
        "updates",
        *(header for _, header, *_ in BASELINE_COLUMNS),
    )
    episodes = ", ".join(sorted({f"{int(run['episodes']):,}" for run in same}))
    return (
        f"{title}{markdown.table(head, rows)}\n"
        f"The last policy of every training seed was evaluated on {episodes} reserved evaluation "
        "seeds; values are interquartile means over training seeds with 95 % bootstrap intervals. "
        "Each algorithm has the same settings on all datasets, listed in the study's files; "
        "`swarmdata study` repeats the runs.\n"
    )


def _row(label: str, runs: Sequence[Run]) -> tuple[str, ...]:
    updates = sorted({int(run["updates"]) for run in runs if run["updates"]})
    return (
        f"`{label}`",
        runs[0]["family"],
        str(len(runs)),
        " to ".join(f"{n:,}" for n in updates),
        *(
            _cell([run[name] for run in runs], factor, digits)
            for name, _, factor, digits in BASELINE_COLUMNS
        ),
    )


def _cell(texts: Sequence[str], factor: float, decimals: int) -> str:
    if not all(texts):
        return "–"
    values = factor * np.array([[float(text)] for text in texts])
    found = bootstrap(iqm, values, generator=np.random.Generator(np.random.PCG64(0)))
    value, low, high = (f"{each:.{decimals}f}" for each in found)
    return f"{value} [{low}, {high}]"
