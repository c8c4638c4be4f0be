"""Writes a dataset's card from its files; nothing on it is typed by hand.

The card is Markdown with the front matter that the Hugging Face Hub reads, and a pure function of
its `Facts`: manifest, recipe, episode table, statistics of the arrays and measured references.
"""

from pathlib import Path

import numpy as np

from swarmdata.cards.recording_card import render_recorded
from swarmdata.cards.reference_file import reference_bytes
from swarmdata.cards.sections.baselines import baselines_section, study_runs
from swarmdata.cards.sections.card_data import Facts, facts_of
from swarmdata.cards.sections.front_matter import bullets, front_matter, snippet
from swarmdata.cards.sections.origin import (
    about_section,
    origin_section,
    splits_section,
    tier_section,
)
from swarmdata.cards.sections.problem import arrays_section, senses_section, task_section
from swarmdata.cards.sections.reward_terms import reward_section
from swarmdata.cards.sections.statistics import (
    coverage_section,
    log_probs_section,
    policies_section,
    statistics_section,
)
from swarmdata.cards.sections.wording import limits_of
from swarmdata.drawing import markdown
from swarmdata.errors import SchemaError
from swarmdata.numerics.random import EVALUATION_BASE
from swarmdata.registry.components import make_task
from swarmdata.registry.published import Interval
from swarmdata.rollouts.metrics import EPISODE_METRICS
from swarmdata.specs.origins import RecordedSpec, task_of
from swarmdata.specs.recipe import Recipe
from swarmdata.store import open_store, write_file
from swarmdata.store.arrays.layout import CARD, REFERENCES
from swarmdata.types import END_REASONS

SHOWN = (
    "return",
    "success",
    "clean_success",
    "time_to_goal",
    "robot_collisions",
    "obstacle_collisions",
)
"""Metrics of the reference table."""


def write_card(folder: Path) -> None:
    """Writes the `side_files` of a finished dataset, the card last."""
    for name, content in side_files(folder).items():
        write_file(folder / name, content)


def side_files(folder: Path) -> dict[str, bytes]:
    """What belongs beside the files of a finished dataset: its card, and references if there are.

    Errors are those of `card_of`.
    """
    spec = open_store(folder, verify="none").recipe.spec
    card, references = card_of(folder).encode(), reference_bytes(spec)
    return {CARD: card} if references is None else {REFERENCES: references, CARD: card}


def card_of(folder: Path, picture: str | None = None) -> str:
    """Renders the card of a finished dataset.

    Args:
        folder: the dataset's.
        picture: file name of its picture, if the card shows one.

    Raises:
        DatasetError: the dataset cannot be used.
        SchemaError: a check that the card reports did not pass.
        SpecError: something stored has no description.
    """
    stored = open_store(folder, verify="none")
    if isinstance(stored.recipe.spec, RecordedSpec):
        return render_recorded(stored, picture)
    return render(facts_of(stored), picture)


def render(facts: Facts, picture: str | None = None) -> str:
    """Returns the card's text; with a picture in the place of the histogram in text.

    Raises:
        SchemaError: a check that the card reports did not pass.
        SpecError: something stored has no description.
    """
    spec = task_of(facts.recipe, "a card of a task")
    task = make_task(spec)
    sections = (
        _identity(facts),
        tier_section(facts.recipe),
        about_section(facts.recipe),
        task_section(task),
        reward_section(task),
        senses_section(spec),
        arrays_section(task, facts.manifest),
        policies_section(facts),
        statistics_section(facts, picture),
        coverage_section(facts),
        log_probs_section(facts),
        splits_section(facts.table, facts.recipe),
        _references(facts),
        baselines_section(facts.recipe.id, facts.manifest.digest, study_runs()),
        bullets("Checks passed", check(facts)),
        bullets("Known limits", _limits(facts)),
        origin_section(facts.recipe, facts.manifest),
    )
    return "".join([front_matter(facts.manifest, facts.recipe), *sections])


def _identity(facts: Facts) -> str:
    manifest, recipe = facts.manifest, facts.recipe
    size = sum(entry.size for entry in manifest.files.values())
    is_shipped = isinstance(recipe, Recipe)
    rows = (
        ("id", f"`{recipe.id}`"),
        ("task", f"`{recipe.spec.task}` version {recipe.spec.version}"),
        ("tier", recipe.tier),
        ("joint steps", f"{manifest.n_steps:,}"),
        ("episodes", f"{manifest.n_episodes:,}"),
        ("size", f"{size / 1e6:,.1f} MB"),
        ("digest of the arrays", f"`{manifest.digest}`"),
        ("recipe" if is_shipped else "origin", f"`{manifest.recipe_hash}`"),
        ("format version", str(manifest.format_version)),
    )
    opening = f'load("{recipe.id}")' if is_shipped else 'Dataset.open("FOLDER OF THIS CARD")'
    return f"\n# {recipe.id}\n\n{snippet(opening)}\n" + markdown.table(("", ""), rows)


def _references(facts: Facts) -> str:
    known = facts.references
    if known is None:
        return "\n## Reference scores\n\nNone measured for this spec.\n"
    rows = [
        (policy, *(_interval(metrics.get(name)) for name in SHOWN))
        for policy, metrics in known.policies.items()
    ]
    score = known.score(float(facts.table.team_return.mean()))
    anchors = "The score needs an expert, which is not measured yet.\n"
    if score is not None:
        anchors = (
            f"Score = 100 (R - {known.no_skill:.3f}) / ({known.expert:.3f} - {known.no_skill:.3f});"
            f" this dataset's own mean return scores {score:.1f}.\n"
        )
    labels = tuple(EPISODE_METRICS[name].label for name in SHOWN)
    return (
        "\n## Reference scores\n\n"
        + markdown.table(("policy", *labels), rows)
        + f"\nMeans over {known.n_episodes:,} reserved evaluation seeds with 95 % bootstrap "
        f"intervals, policies without noise. {anchors}"
        f"`{REFERENCES}` beside this card has all digits, and every metric.\n"
    )


def check(facts: Facts) -> tuple[str, ...]:
    """Returns what holds of this dataset.

    Raises:
        SchemaError: naming what does not hold, which must not happen to what a recipe makes.
    """
    holds, broken = checked(facts)
    if broken and isinstance(facts.recipe, Recipe):
        raise SchemaError(f"{facts.recipe.id} fails its checks: {' '.join(broken)}")
    return holds


def checked(facts: Facts) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Claims about this dataset that hold, and those that do not."""
    table, spec = facts.table, task_of(facts.recipe, "checking")
    claims = {
        "No episode has a reserved evaluation seed.": (table.seeds < EVALUATION_BASE).all(),
        "No seed occurs twice.": len(np.unique(table.seeds)) == len(table),
        "No episode is longer than the horizon.": (table.lengths <= spec.horizon).all(),
        "Every episode that was not solved or failed has the horizon's length.": (
            table.lengths[table.end_reason == END_REASONS.index("horizon")] == spec.horizon
        ).all(),
        "Every return is finite.": np.isfinite(table.team_return).all(),
    }
    if isinstance(facts.recipe, Recipe):
        is_whole = facts.manifest.n_steps >= facts.recipe.n_steps
        claims["The dataset has the steps of its recipe."] = is_whole
    return (
        tuple(claim for claim, holds in claims.items() if holds),
        tuple(claim for claim, holds in claims.items() if not holds),
    )


def _limits(facts: Facts) -> tuple[str, ...]:
    known = limits_of(facts.recipe.spec.task, facts.recipe.tier)
    return (*known, *(f"This does not hold: {claim}" for claim in checked(facts)[1]))


def _interval(interval: Interval | None) -> str:
    if interval is None:
        return "never"
    return f"{interval.value:.3f} [{interval.low:.3f}, {interval.high:.3f}]"
