"""Writes a dataset's card from its files: Markdown with the front matter that the Hub reads."""

from pathlib import Path

import numpy as np

from swarmdata.cards.committed_studies import committed_studies
from swarmdata.cards.recording_card import render_recorded
from swarmdata.cards.references import reference_bytes, references_section
from swarmdata.cards.sections.baselines import baselines_section
from swarmdata.cards.sections.front_matter import bullets, front_matter, identity_section
from swarmdata.cards.sections.measured_content import CardData, card_data_of
from swarmdata.cards.sections.origin import (
    about_section,
    origin_section,
    splits_section,
    tier_section,
)
from swarmdata.cards.sections.problem import (
    arrays_section,
    definitions_section,
    reward_section,
    senses_section,
    task_section,
)
from swarmdata.cards.sections.statistics import (
    coverage_section,
    log_probs_section,
    policies_section,
    statistics_section,
)
from swarmdata.cards.sections.wording import limits_of
from swarmdata.errors import SchemaError
from swarmdata.numerics.random import EVALUATION_BASE
from swarmdata.registry.components import make_task
from swarmdata.specs.origins import task_of
from swarmdata.store import open_store, write_file
from swarmdata.store.arrays.layout import CARD, REFERENCES
from swarmdata.types import END_REASONS

FOREIGN_REWARDS = (
    "\n## Reward\n\nThe rewards are not those of the task, which are its terms (`reward_terms`) "
    "times the weights of the spec.\n"
)


def write_card(folder: Path) -> None:
    """Writes the `side_files` of a finished dataset, the card last."""
    for name, content in side_files(folder).items():
        write_file(folder / name, content)


def side_files(folder: Path) -> dict[str, bytes]:
    """The card of a finished dataset, and its references if there are any, by file name.

    Errors are those of `card_of`.
    """
    spec = open_store(folder, verify="none").recipe.spec
    card, references = card_of(folder).encode(), reference_bytes(spec)
    return {CARD: card} if references is None else {REFERENCES: references, CARD: card}


def card_of(folder: Path, picture: str | None = None) -> str:
    """Renders the card of a finished dataset; `picture` is the file name of one that it shows.

    Raises:
        DatasetError: the dataset cannot be used.
        SchemaError: a check that the card reports did not pass.
        SpecError: something stored has no description.
        StudyError: a study of this installation cannot be read.
    """
    stored = open_store(folder, verify="none")
    if stored.recipe.missing is not None and (folder / CARD).is_file():
        return (folder / CARD).read_text("utf-8")  # the package that defines it has made it
    if stored.recipe.spec.world is None:
        return render_recorded(stored, picture)
    return render(card_data_of(stored), picture)


def render(data: CardData, picture: str | None = None) -> str:
    """Returns the card's text, as `card_of` does; a picture replaces the histogram in text."""
    spec = task_of(data.origin, "a card of a task")
    task = make_task(spec)
    mean = float(data.table.team_return.mean())
    holds, broken = check(data)
    violated = (f"This claim does not hold: {claim}" for claim in broken)
    sections = (
        identity_section(data.manifest, data.origin),
        tier_section(data.origin),
        about_section(data.origin),
        statistics_section(data, picture),
        policies_section(data),
        references_section(data.references, spec, mean, has_task_rewards=data.has_task_rewards),
        baselines_section(data.origin.id, data.manifest.digest, committed_studies()),
        coverage_section(data),
        log_probs_section(data),
        splits_section(data.table, data.origin),
        bullets("Known limits", (*limits_of(spec, data.origin.tier), *violated)),
        task_section(task),
        reward_section(task) if data.has_task_rewards else FOREIGN_REWARDS,
        senses_section(spec),
        arrays_section(task, data.manifest),
        definitions_section(task),
        bullets("Checks passed", holds),
        origin_section(data.origin, data.manifest),
    )
    return "".join([front_matter(data.manifest, data.origin), *sections])


def check(data: CardData) -> tuple[list[str], list[str]]:
    """Returns the claims about a dataset that hold, and those that do not.

    Raises:
        SchemaError: names the claims that fail for a dataset that a recipe generated.
    """
    table, spec = data.table, task_of(data.origin, "checking")
    claims = {
        "No episode has a reserved evaluation seed.": (table.seeds < EVALUATION_BASE).all(),
        "No seed occurs twice.": len(np.unique(table.seeds)) == len(table),
        "No episode is longer than the horizon.": (table.lengths <= spec.horizon).all(),
        "Every truncated episode has the length of the horizon.": (
            table.lengths[table.end_reason == END_REASONS.index("horizon")] == spec.horizon
        ).all(),
        "Every return is finite.": np.isfinite(table.team_return).all(),
    }
    if data.origin.recipe is not None:
        is_whole = data.manifest.n_steps >= data.origin.recipe.n_steps
        claims["The dataset has at least the joint steps of its recipe."] = is_whole
    broken = [claim for claim, holds in claims.items() if not holds]
    if broken and data.origin.recipe is not None:
        raise SchemaError(f"{data.origin.id} fails its checks: {' '.join(broken)}")
    return [claim for claim, holds in claims.items() if holds], broken
