"""Place and size: what policies reach in tasks that they were not trained in."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from swarmdata.evaluation.figures.score_matrix import plot_score_matrix
from swarmdata.evaluation.results.result_tables import QUANTITIES
from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.shifts.shift_sections import task_section
from swarmdata.evaluation.study.shifts.shift_table import TASKS_FILE, Shifted, read_shifts

SUCCESS, CLEAN = QUANTITIES["success"], QUANTITIES["clean_success"]


def answer_other_places(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from studies whose policies were evaluated in other tasks."""
    sentences, headlines, parts, figures, chosen = [], [], [], [], []
    for each in evidence:
        rows = read_shifts(each.folder / TASKS_FILE)
        for dataset in dict.fromkeys(row.dataset for row in rows):
            here = [row for row in rows if row.dataset == dataset]
            sentences += list(place_sentences(dataset, here))
            headlines.append(most_solved(dataset, here))
            figures.append(f"places-{each.name}-{dataset}.png")
            plot_score_matrix(
                _success(here), out / figures[-1], label=SUCCESS.column.header, decimals=0
            )
            parts.append(
                f"Episodes solved (%) after training on {dataset}, study {each.name}; empty: the "
                f"policies cannot read teams of another size.\n\n"
                f"![episodes solved by task]({figures[-1]})\n"
            )
        if rows:
            chosen.append(each)
            parts += task_section(each.found, rows).values()
    if not parts:
        return None
    headline = " ".join(headlines)
    return Answer(headline, tuple(sentences), "\n".join(parts), tuple(chosen), tuple(figures))


def most_solved(dataset: str, rows: Sequence[Shifted]) -> str:
    """The most that policies of a dataset solve in each task."""
    solved = {task: found for task, found in _success(rows).items() if found}
    shown = ", ".join(f"{max(found.values()):.0f} % of {task}" for task, found in solved.items())
    return f"The best policies from {dataset} solve {shown or 'no task that they fit'}."


def place_sentences(dataset: str, rows: Sequence[Shifted]) -> Iterator[str]:
    """The policies that solve most in each task."""
    for task in dict.fromkeys(row.used_with for row in rows):
        known = [
            row for row in rows if row.used_with == task and SUCCESS.column.key in row.estimates
        ]
        best = max(known, key=lambda row: row.estimates[SUCCESS.column.key].value, default=None)
        if best is None:
            yield f"On {task}, no policies that learned on {dataset} fit."
        elif best.estimates[SUCCESS.column.key].value == 0.0:
            yield (
                f"On {task}, no policies that learned on {dataset} solve any of "
                f"{best.n_episodes:,} episodes."
            )
        else:
            yield (
                f"On {task}, of policies that learned on {dataset}, those of `{best.label}` solve "
                f"most: {best.text(SUCCESS)} % of {best.n_episodes:,} episodes, {best.text(CLEAN)} "
                "% without a collision."
            )


def _success(rows: Sequence[Shifted]) -> dict[str, dict[str, float]]:
    """Task -> label -> solved episodes, %."""
    found: dict[str, dict[str, float]] = {}
    for row in rows:
        column = SUCCESS.column
        by_label = found.setdefault(row.used_with, {})
        if column.key in row.estimates:
            by_label[row.label] = column.factor * row.estimates[column.key].value
    return found
