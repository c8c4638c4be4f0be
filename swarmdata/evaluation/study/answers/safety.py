"""Safety: success against clean success and collisions, and what safe rewards change."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from swarmdata.drawing import markdown
from swarmdata.evaluation.results.estimate_table import format_estimate
from swarmdata.evaluation.study.answers.answer import Answer
from swarmdata.evaluation.study.answers.compared_rows import (
    Compared,
    compared_rows,
    sentence_of,
    tables_of,
)
from swarmdata.evaluation.study.answers.evidence import Evidence
from swarmdata.evaluation.study.pages.row_differences import (
    RowDifference,
    format_difference,
    verdict_of,
)
from swarmdata.evaluation.study.pages.safety_section import (
    COLLISIONS,
    Fronts,
    collision_board,
    front_sentences,
    fronts_of,
    plot_safety,
)
from swarmdata.evaluation.study.pages.scoreboard import make_scoreboard
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.plain_names import without_version

DIFFERENCES = "rewards"
"""What studies call pairs of a row that learned from safe rewards and one that did not."""


def answer_safety(evidence: Sequence[Evidence], out: Path) -> Answer | None:
    """Answers from studies on the reserved seeds, and from those that compare rewards."""
    compared = compared_rows(evidence, DIFFERENCES)
    with_rewards = [each.evidence for each in compared]
    chosen = [each for each in evidence if each.compares_rows or each in with_rewards]
    if not chosen:
        return None
    headline = " ".join([*_shares(chosen[0]), *_changed_collisions(compared)])
    sentences = [sentence for each in chosen for sentence in _most_and_cleanest(each)]
    sentences += [sentence for pairs in compared for sentence in _changes(pairs)]
    figures, parts = [], []
    for each in chosen:
        figures.append(f"safety-{each.name}.png")
        plot_safety(each.found, _best_of_families(each), out / figures[-1])
        bullets = "".join(f"- {line}\n" for line in front_sentences(fronts_of(each.found)))
        parts.append(
            f"Study {each.name}, the row of each family that solves most:\n\n"
            f"![success, clean success and collisions]({figures[-1]})\n\n{bullets}\n"
            f"{_table(each)}"
        )
    parts += [tables_of(compared)] if compared else []
    return Answer(headline, tuple(sentences), "\n".join(parts), tuple(chosen), tuple(figures))


def _best_of_families(evidence: Evidence) -> dict[str, Fronts]:
    """The fronts of each dataset, among the rows of each family that solve most."""
    board = make_scoreboard(evidence.found.results, evidence.families, "success")
    best = {without_version(name): board.best_by_family(name).values() for name in board.values}
    return {name: each.among(best[name]) for name, each in fronts_of(evidence.found).items()}


def _shares(evidence: Evidence) -> Iterator[str]:
    """How much of what the most successful rows solve is clean, over the datasets of a study."""
    found = evidence.found
    success, clean = (
        make_scoreboard(found.results, found.families, key) for key in ("success", "clean_success")
    )
    shares = {}
    for dataset, estimates in success.estimates.items():
        best = success.ranking(dataset)[0]
        if estimates[best].value > 0.0:
            share = clean.estimates[dataset][best].value / estimates[best].value
            shares[without_version(dataset)] = share
    if not shares:
        yield f"No row of study {evidence.name} solves an episode."
        return
    ranked = sorted(shares, key=shares.__getitem__)
    least, most = (f"{100 * shares[name]:.0f} % ({name})" for name in (ranked[0], ranked[-1]))
    yield (
        f"Of the episodes that the most successful row of study {evidence.name} solves, {least} to "
        f"{most} are without a collision."
    )


def _changed_collisions(compared: Sequence[Compared]) -> Iterator[str]:
    """In how many comparisons safe rewards change collisions and the main quantity."""
    if not compared:
        return
    crashes, verdicts = [], []
    for each in compared:
        for pair, change in _with_collisions(each):
            crashes.append(verdict_of(change))
            verdicts.append(verdict_of(pair.estimates[each.columns[0].key]))
    yield (
        f"Safe rewards lower collisions clearly in {crashes.count('lower')} of {len(crashes)} "
        f"comparisons, and the {compared[0].columns[0].label} in {verdicts.count('lower')}."
    )


def _with_collisions(compared: Compared) -> Iterator[tuple[RowDifference, Estimate]]:
    """Each pair, and how its collisions differ, paired by episode."""
    crashes = collision_board(compared.evidence.found)
    ids = {without_version(name): name for name in crashes.values}
    for each in compared.differences:
        yield each, crashes.lead(ids[without_version(each.dataset)], each.one, each.other)


def _changes(compared: Compared) -> Iterator[str]:
    """What safe rewards change, collisions among it."""
    for each, change in _with_collisions(compared):
        yield (
            f"{each.words} on {each.dataset}: {sentence_of(each, compared.columns)}, "
            f"{COLLISIONS.label} {format_difference(change, COLLISIONS)} ({verdict_of(change)})."
        )


def _most_and_cleanest(evidence: Evidence) -> Iterator[str]:
    """For each dataset, how much of the best success is clean, and which row is cleanest."""
    found = evidence.found
    success, clean = (
        make_scoreboard(found.results, found.families, key) for key in ("success", "clean_success")
    )
    for dataset, estimates in success.estimates.items():
        best, cleanest = success.ranking(dataset)[0], clean.ranking(dataset)[0]
        where = f"On {without_version(dataset)} (study {evidence.name})"
        if estimates[best].value == 0.0:
            yield f"{where}, no algorithm solves an episode."
            continue
        solved = format_estimate(estimates[best], success.column)
        tidy = format_estimate(clean.estimates[dataset][best], clean.column)
        text = (
            f"{where}, `{best}` solves most: {solved} % of the episodes, {tidy} % without a "
            "collision"
        )
        if cleanest == best:
            yield f"{text}, which is also the most."
        else:
            lead = clean.lead(dataset, cleanest, best)
            chance = "" if lead.low > 0.0 else ", which may be chance"
            yield (
                f"{text}; `{cleanest}` solves {format_estimate(lead, clean.column)} percentage "
                f"points more without a collision{chance}."
            )


def _table(evidence: Evidence) -> str:
    """A row for each dataset and row of the study."""
    found = evidence.found
    boards = [
        *(make_scoreboard(found.results, found.families, k) for k in ("success", "clean_success")),
        collision_board(found),
    ]
    rows = [
        (
            without_version(dataset),
            f"`{label}`",
            *(format_estimate(each.estimates[dataset][label], each.column) for each in boards),
        )
        for dataset, estimates in boards[0].estimates.items()
        for label in estimates
    ]
    return markdown.table(("dataset", "row", *(each.column.header for each in boards)), rows)
