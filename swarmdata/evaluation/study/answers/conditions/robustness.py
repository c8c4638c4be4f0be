"""Robustness: what worse radios and sensors than those of the training cost."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.evaluation.figures.line_panels import LinePanel, plot_line_panels
from swarmdata.evaluation.results.estimate_table import Column, format_estimate
from swarmdata.evaluation.results.result_tables import QUANTITIES, RETURN, SCORE
from swarmdata.evaluation.robustness.sweep_plots import AXIS_LABELS
from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.cells.study_data import short_name
from swarmdata.evaluation.study.pages.row_differences import format_difference
from swarmdata.evaluation.study.shifts.sweep_files import (
    SWEEP_FILE,
    SWEEPS_FOLDER,
    SweptAxis,
    SweptPoint,
    read_sweeps,
)
from swarmdata.rollouts.score_statistics import Estimate

SUCCESS, CLEAN = QUANTITIES["success"], QUANTITIES["clean_success"]


def answer_robustness(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from studies that sweep parameters of radios and sensors."""
    sentences, solved, parts, figures, chosen = [], [], [], [], []
    for each in evidence:
        axes = [axis for axis in read_sweeps(each.folder) if axis.label in each.found.study.sweeps]
        if axes:
            sentences += [_sentence(each, axis) for axis in axes]
            solved += [_most_solved(axis) for axis in axes]
            figures.append(f"robustness-{each.name}.png")
            panels = [_panel(axis) for axis in axes]
            label = SUCCESS.column.header
            plot_line_panels(panels, each.found.looks, out / figures[-1], ylabel=label)
            parts.append(
                f"Episodes solved, by what gets worse from left to right (study {each.name}, "
                f"{axes[0].n_episodes:,} episodes a point; everything else is as in training):\n\n"
                f"![episodes solved by condition]({figures[-1]})\n\n"
                + "\n".join(_table(each, axis, out) for axis in axes)
            )
            chosen.append(each)
    if not parts:
        return None
    headline = (
        "Episodes that the best policies solve as trained, and those that the best ones solve at "
        f"the worst value: {'; '.join(solved)}."
    )
    return Answer(headline, tuple(sentences), "\n".join(parts), tuple(chosen), tuple(figures))


def _most_solved(axis: SweptAxis) -> str:
    """The highest success as trained and at the worst value of an axis."""
    column, lines = SUCCESS.column, axis.lines.values()
    trained = [point for points in lines for point in points if point.is_trained]
    worst = [points[-1] for points in lines]
    before, after = (
        max(column.factor * point.estimates[column.key].value for point in points)
        for points in (trained, worst)
    )
    return f"{axis.part} {axis.parameter} {worst[0].value:g}: {before:.0f} and {after:.0f} %"


def _sentence(evidence: Evidence, axis: SweptAxis) -> str:
    """What the worst value costs which row most and least."""
    column, changes = _changes(axis)
    ranked = sorted(changes, key=lambda label: -changes[label].value)
    shown = {label: format_difference(changes[label], column) for label in ranked}
    dataset = short_name(evidence.found.study.sweeps[axis.label].dataset)
    worst = next(iter(axis.lines.values()))[-1].value
    where = f"On {dataset}, {axis.part} {axis.parameter} {worst:g}"
    if len(ranked) == 1:
        return f"{where} changes the {column.label} of `{ranked[0]}` by {shown[ranked[0]]}."
    return (
        f"{where} changes the {column.label} least for `{ranked[0]}`, by {shown[ranked[0]]}, and "
        f"most for `{ranked[-1]}`, by {shown[ranked[-1]]}."
    )


def _changes(axis: SweptAxis) -> tuple[Column, dict[str, Estimate]]:
    """The change of each row's score, or return, at the worst value, and its column."""
    ends = {label: points[-1].estimates for label, points in axis.lines.items()}
    quantity = next(
        each for each in (SCORE, RETURN) if f"{each.column.key}_change" in next(iter(ends.values()))
    )
    key = f"{quantity.column.key}_change"
    return quantity.column, {label: estimates[key] for label, estimates in ends.items()}


def _panel(axis: SweptAxis) -> LinePanel:
    """Episodes solved along an axis."""
    column = SUCCESS.column
    lines = {
        label: {
            point.value: Estimate(*(column.factor * each for each in point.estimates[column.key]))
            for point in points
            if point.value is not None
        }
        for label, points in axis.lines.items()
    }
    label = AXIS_LABELS.get((axis.part, axis.parameter), f"{axis.part} {axis.parameter}")
    return LinePanel(axis.label, label, lines, falls=axis.falls)


def _table(evidence: Evidence, axis: SweptAxis, out: Path) -> str:
    """A row for each row of the study: as trained, and at the worst value."""
    column, changes = _changes(axis)
    rows = [
        (
            f"`{label}`",
            *_solved(next(point for point in points if point.is_trained)),
            *_solved(points[-1]),
            format_difference(changes[label], column),
        )
        for label, points in axis.lines.items()
    ]
    worst = f"{axis.parameter} {next(iter(axis.lines.values()))[-1].value:g}"
    columns = (SUCCESS.column.header, CLEAN.column.header)
    head = (
        axis.label,
        *(f"{each}, as trained" for each in columns),
        *(f"{each}, {worst}" for each in columns),
        f"change of {column.label}",
    )
    folder = evidence.folder / SWEEPS_FOLDER / axis.label / SWEEP_FILE
    link = Path(os.path.relpath(folder, out)).as_posix()
    return f"{markdown.table(head, rows)}\n[All values]({link}).\n"


def _solved(point: SweptPoint) -> Iterator[str]:
    for each in (SUCCESS, CLEAN):
        yield format_estimate(point.estimates[each.column.key], each.column)
