"""The section of a card with baselines: what algorithms learned from the dataset."""

from collections.abc import Sequence

from swarmdata.cards.committed_studies import CommittedStudy, Means
from swarmdata.drawing import markdown
from swarmdata.registry.components import OFFLINE_ALGORITHMS
from swarmdata.rollouts.score_intervals import target_of

BASELINES_TITLE = "\n## Baselines\n"

BASELINE_COLUMNS = (
    ("score", "score", 1.0, 1),
    ("success", "success (%)", 100.0, 1),
)
"""Columns: quantity in the file, header, factor to the shown unit, decimals."""


def baselines_section(dataset_id: str, digest: str, studies: Sequence[CommittedStudy]) -> str:
    """Returns the section: one row per algorithm, or why there is none.

    The rows are those of one study, so that they compare: of one on evaluation seeds if there is
    any, and there of the one with the most algorithms. Results on data of another digest are left
    out; variants, and what learned from other rewards, are left to the study's page.

    Raises:
        StudyError: the plan of a study that used the dataset cannot be read.
    """
    named = {study.name: _where(study.estimates, "dataset", dataset_id) for study in studies}
    same = {name: _where(rows, "digest", digest) for name, rows in named.items()}
    if of_sides := [study.name for study in studies if _has_sides(study, dataset_id, digest)]:
        return f"{BASELINES_TITLE}\nStudies of its sides: {_listed(of_sides)}.\n"
    if not any(same.values()):
        stale = " The runs of the study used other data with this id." * any(named.values())
        whole = dataset_id.replace("-mini-", "-")
        if whole != dataset_id and any(_where(s.estimates, "dataset", whole) for s in studies):
            stale += f" Those on the whole dataset: the card of `{whole}`."
        return f"{BASELINES_TITLE}\nNo results on this dataset yet.{stale}\n"
    names = [name for name, rows in same.items() if rows]
    found = [(study, _by_algorithm(same[study.name])) for study in studies]
    found = sorted((each for each in found if each[1]), key=lambda each: -len(each[1]))
    if not found:
        return f"{BASELINES_TITLE}\nStudies of variants of algorithms: {_listed(names)}.\n"
    best, algorithms = next((each for each in found if not each[0].chose_settings), found[0])
    names.remove(best.name)
    return f"{BASELINES_TITLE}\n{_table(algorithms)}\n{_source(best, algorithms, names)}\n"


def _has_sides(study: CommittedStudy, dataset_id: str, digest: str) -> bool:
    rows = _where(study.estimates, "digest", digest)
    return any(row["dataset"].startswith(f"{dataset_id}@") for row in rows)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _where(rows: Sequence[Means], column: str, value: str) -> list[Means]:
    return [row for row in rows if row[column] == value]


Algorithms = dict[str, dict[str, Means]]  # label -> quantity -> row


def _by_algorithm(rows: Sequence[Means]) -> Algorithms:
    """The rows of algorithms as they are registered, by their mean return, the best first."""
    found: Algorithms = {}
    for row in rows:
        if row["label"] in OFFLINE_ALGORITHMS and not row["rewards"]:
            found.setdefault(row["label"], {})[row["quantity"]] = row
    return dict(sorted(found.items(), key=lambda it: -float(it[1]["return"]["mean"])))


def _table(algorithms: Algorithms) -> str:
    head = ("algorithm", *(header for _, header, *_ in BASELINE_COLUMNS))
    rows = [
        (
            f"`{label}`",
            *(_cell(found.get(name), factor, n) for name, _, factor, n in BASELINE_COLUMNS),
        )
        for label, found in algorithms.items()
    ]
    return markdown.table(head, rows)


def _cell(found: Means | None, factor: float, decimals: int) -> str:
    if found is None or not found["mean"]:
        return "–"
    value, *ends = (
        f"{factor * float(found[key]):.{decimals}f}"
        for key in ("mean", "low", "high")
        if found[key]
    )
    return f"{value} [{', '.join(ends)}]" if ends else value


def _source(study: CommittedStudy, algorithms: Algorithms, others: Sequence[str]) -> str:
    rows = [row for found in algorithms.values() for row in found.values()]
    seeds, updates, episodes = (
        " or ".join(f"{n:,}" for n in sorted({int(row[key]) for row in rows if row[key]}))
        for key in ("seeds", "updates", "episodes")
    )
    block = "validation" if study.chose_settings else "reserved evaluation"
    more = f" Other studies of this dataset: {_listed(others)}."
    return (
        f"From the study `{study.name}`: the last policies of {seeds} training seeds after "
        f"{updates} updates, on {episodes} {block} seeds; means with 95 % intervals for "
        f"{target_of([int(row['seeds']) for row in rows])}. Settings, variants and other "
        f"quantities are in `cards/studies/{study.name}` of the repository.{more if others else ''}"
    )
