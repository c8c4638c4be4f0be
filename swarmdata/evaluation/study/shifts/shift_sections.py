"""The sections on policies in other conditions than those of their training."""

from collections.abc import Mapping, Sequence

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import UNDEFINED
from swarmdata.evaluation.results.result_tables import QUANTITIES, Quantity
from swarmdata.evaluation.study.pages.collect_results import Findings
from swarmdata.evaluation.study.pages.scoreboard import quantity_of
from swarmdata.evaluation.study.shifts.shift_table import Shifted


def transfer_section(found: Findings, rows: Sequence[Shifted]) -> dict[str, str]:
    """A matrix for each dataset and algorithm, by the section's title; empty without rows."""
    if not rows:
        return {}
    quantity = quantity_of(found.results)
    text = (
        "Rows are the view that a policy learned in, columns that of its evaluation, on "
        f"{rows[0].n_episodes:,} seeds: {quantity.column.label}.\n\n"
    )
    tables = [
        f"`{label}` on {dataset}:\n\n{_matrix(group, quantity)}"
        for (dataset, label), group in _grouped(rows).items()
    ]
    return {"Information: learned with one, used with another": text + "\n".join(tables)}


def _grouped(rows: Sequence[Shifted]) -> dict[tuple[str, str], list[Shifted]]:
    groups: dict[tuple[str, str], list[Shifted]] = {}
    for row in rows:
        groups.setdefault((row.dataset, row.label), []).append(row)
    return groups


def _matrix(rows: Sequence[Shifted], quantity: Quantity) -> str:
    """A row for each view that was learned in, a column for each of evaluation."""
    texts = {(row.trained_with, row.used_with): row.text(quantity) for row in rows}
    views = list(dict.fromkeys(row.used_with for row in rows))
    learned = dict.fromkeys(row.trained_with for row in rows)
    return markdown.table(
        ("learned with", *views),
        [(f"`{one}`", *(texts.get((one, other), UNDEFINED) for other in views)) for one in learned],
    )


def task_section(found: Findings, rows: Sequence[Shifted]) -> dict[str, str]:
    """A table for each dataset and quantity, by the section's title; empty without rows."""
    if not rows:
        return {}
    quantities = (quantity_of(found.results), QUANTITIES["success"], QUANTITIES["clean_success"])
    text = (
        "Policies of the study in tasks that they were not trained in, on "
        f"{rows[0].n_episodes:,} seeds. Sensors and radios are those of their training. A score is "
        "between doing nothing and the expert in each task.\n\n"
    )
    by_dataset: dict[str, dict[str, dict[str, Shifted]]] = {}
    for row in rows:
        by_dataset.setdefault(row.dataset, {}).setdefault(row.label, {})[row.used_with] = row
    tables = [
        _task_table(dataset, by_label, quantity)
        for dataset, by_label in by_dataset.items()
        for quantity in quantities
    ]
    return {"Other places and sizes of teams": text + "\n".join(tables)}


def _task_table(
    dataset: str, by_label: Mapping[str, Mapping[str, Shifted]], quantity: Quantity
) -> str:
    """A row for each algorithm, a column for each task."""
    tasks = list(dict.fromkeys(task for found in by_label.values() for task in found))
    rows = [
        (
            f"`{label}`",
            *(found[task].text(quantity) if task in found else UNDEFINED for task in tasks),
        )
        for label, found in by_label.items()
    ]
    return markdown.table((f"{dataset}: {quantity.column.header}", *tasks), rows)
