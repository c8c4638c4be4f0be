"""The sections on safety: success, success without a collision, and collisions of every row."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmdata.evaluation.results.aggregates import collisions, pareto_front
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.results.result_plots import plot_pareto
from swarmdata.evaluation.study.pages.collect_results import Findings, facts_by_dataset
from swarmdata.evaluation.study.pages.scoreboard import Scoreboard, make_scoreboard, quantity_of
from swarmdata.evaluation.study.pages.study_figures import Looks, plot_fronts, plot_two_estimates
from swarmdata.evaluation.study.pages.study_tables import scoreboard_table
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version

MAX_ALGORITHMS_IN_FIGURE = 24
"""Algorithms whose names fit beside a figure; with more, some figures are left out."""

COLLISIONS = Column("collisions", "collisions per episode", "", 2)
"""New contacts of a robot with others and with obstacles, counted from events."""

Pairs = Mapping[str, tuple[Estimate, Estimate]]
"""Label -> horizontal and vertical estimate, in shown units."""


@dataclass(frozen=True)
class Fronts:
    """Success of every row on a dataset, against clean success and against collisions.

    Attributes:
        clean: label -> clean success and success, in percent.
        collisions: label -> collisions per episode, and success in percent.
    """

    clean: Pairs
    collisions: Pairs

    @property
    def cleanest(self) -> tuple[str, ...]:
        """Labels that no other exceeds in success or clean success without loss in the other."""
        return _front(self.clean, sign=-1.0)

    @property
    def safest(self) -> tuple[str, ...]:
        """Labels of which no other has as much success at fewer collisions, or more at as few."""
        return _front(self.collisions, sign=1.0)


def _front(points: Pairs, sign: float) -> tuple[str, ...]:
    values = [y.value for _, y in points.values()]
    found = pareto_front(values, [sign * x.value for x, _ in points.values()])
    return tuple(label for label, is_best in zip(points, found.tolist(), strict=True) if is_best)


def fronts_of(found: Findings) -> dict[str, Fronts]:
    """The fronts of each dataset, by its name without version."""
    success, clean = (
        make_scoreboard(found.results, found.families, key) for key in ("success", "clean_success")
    )
    crashes = collision_board(found)
    return {
        without_version(dataset): Fronts(
            _in_both(clean, success, dataset), _in_both(crashes, success, dataset)
        )
        for dataset in success.estimates
    }


def collision_board(found: Findings) -> Scoreboard:
    """Collisions with robots and obstacles together; fewer are better, so its ranks mean little."""
    values = {
        case.name: {
            label: collisions(case, label) for label in found.families if label in case.runs
        }
        for case in found.results.cases
    }
    data = {
        dataset: facts.robot_collisions + facts.obstacle_collisions
        for dataset, facts in facts_by_dataset(found.facts).items()
    }
    return Scoreboard(COLLISIONS, values, data, found.families)


def _in_both(x: Scoreboard, y: Scoreboard, dataset: str) -> Pairs:
    first, second = x.in_shown_units(dataset), y.in_shown_units(dataset)
    return {label: (first[label], second[label]) for label in first if label in second}


def plot_safety(fronts: Mapping[str, Fronts], looks: Looks, path: Path) -> None:
    """Draws success against clean success, and against collisions: a row for each dataset."""
    panels = {
        dataset: (("clean success (%)", each.clean), (COLLISIONS.label, each.collisions))
        for dataset, each in fronts.items()
    }
    optimal = {dataset: (each.cleanest, each.safest) for dataset, each in fronts.items()}
    plot_fronts(panels, optimal, looks, path, ylabel="success (%)")


def front_sentences(fronts: Mapping[str, Fronts]) -> list[str]:
    """Which rows are Pareto-optimal on each dataset."""
    return [
        f"On {dataset}, Pareto-optimal in success and clean success: {_names(each.cleanest)}; in "
        f"success and collisions: {_names(each.safest)}."
        for dataset, each in fronts.items()
    ]


def _names(labels: Sequence[str]) -> str:
    return ", ".join(f"`{label}`" for label in labels)


def safety_sections(found: Findings, out: Path) -> dict[str, str]:
    """The sections by title.

    Args:
        found: what was measured.
        out: folder for the figures.
    """
    boards = {
        key: make_scoreboard(found.results, found.families, key)
        for key in (quantity_of(found.results).column.key, "success", "clean_success")
    }
    board, success, clean = boards.values()
    fronts = fronts_of(found)
    crashes = collision_board(found)
    plot_safety(fronts, found.looks, out / "safety.png")
    bullets = "".join(f"- {sentence}\n" for sentence in front_sentences(fronts))
    panels = {
        without_version(dataset): _in_both(clean, board, dataset)
        for dataset in clean.estimates
        if dataset in board.estimates
    }
    plot_two_estimates(
        panels, found.looks, out / "clean.png",
        xlabel="clean success (%)", ylabel=board.column.label, xlim=(-3.0, 103.0),
    )  # fmt: skip
    body = (
        f"Episodes solved (%):\n\n{scoreboard_table(success)}\n"
        f"Episodes solved without a collision (%):\n\n{scoreboard_table(clean)}\n"
        "Collisions per episode, which are new contacts with robots and obstacles (fewer are "
        f"better):\n\n{scoreboard_table(crashes, is_ranked=False)}\n"
        f"{bullets}\n"
        "Filled points are Pareto-optimal.\n\n"
        "![success against clean success and collisions](safety.png)\n\n"
        f"![{board.column.label} against clean success](clean.png)\n"
    )
    return {"Success and collisions": body, **_return_section(found, out)}


def _return_section(found: Findings, out: Path) -> dict[str, str]:
    if len(found.results.labels) > MAX_ALGORITHMS_IN_FIGURE:
        return {}
    plot_pareto(found.results.cases, out / "collisions.png", found.looks)
    body = (
        "Filled points are Pareto-optimal on their dataset; the dashed line is the mean return of "
        "the data.\n\n![team return against collisions](collisions.png)\n"
    )
    return {"Return and collisions": body}
