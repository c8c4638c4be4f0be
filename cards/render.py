"""Writes a dataset's card from its files; nothing on it is typed by hand.

The card is Markdown with the front matter that the Hugging Face Hub reads, and a pure function of
its `Facts`: manifest, recipe, episode table, statistics of the arrays and measured references.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from swarmdata.cards import markdown
from swarmdata.cards.facts import Facts, facts_of
from swarmdata.cards.meaning import TIERS, UNKNOWN_TIER, limits_of
from swarmdata.cards.problem import arrays_section, senses_section, task_section
from swarmdata.cards.schema import Interval
from swarmdata.cards.statistics import (
    coverage_section,
    log_probs_section,
    policies_section,
    statistics_section,
)
from swarmdata.errors import SchemaError
from swarmdata.metrics import EPISODE_METRICS
from swarmdata.registry import make_task
from swarmdata.seeding import EVALUATION_BASE
from swarmdata.store import SPLITS, write_file
from swarmdata.store.layout import CARD
from swarmdata.types import END_REASONS

SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
"""The Hub's size categories, by joint steps below."""

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
    """Writes the card of a finished dataset beside its files; errors are those of `card_of`."""
    write_file(folder / CARD, card_of(folder).encode())


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
    return render(facts_of(folder), picture)


def render(facts: Facts, picture: str | None = None) -> str:
    """Returns the card's text; with a picture in the place of the histogram in text.

    Raises:
        SchemaError: a check that the card reports did not pass.
        SpecError: something stored has no description.
    """
    spec = facts.recipe.spec
    task = make_task(spec)
    sections = (
        _identity(facts),
        f"\n## Tier\n\n{TIERS.get(facts.recipe.tier, UNKNOWN_TIER)}\n",
        task_section(task),
        senses_section(spec),
        arrays_section(task, facts.manifest),
        policies_section(facts),
        statistics_section(facts, picture),
        coverage_section(facts),
        log_probs_section(facts),
        _splits(facts),
        _references(facts),
        _bullets("Checks passed", check(facts)),
        _bullets("Known limits", limits_of(spec.task, facts.recipe.tier)),
        _rebuild(facts),
    )
    return "".join([_front_matter(facts), *sections])


def _front_matter(facts: Facts) -> str:
    size = next((name for below, name in SIZES if facts.manifest.n_steps < below), "1M<n<10M")
    recipe = facts.recipe
    content = {
        "pretty_name": recipe.id,
        "license": "cc-by-4.0",
        "task_categories": ["reinforcement-learning", "robotics"],
        "tags": ["swarmdata", "offline-rl", "multi-agent", "zarr", recipe.spec.task, recipe.tier],
        "size_categories": [size],
    }
    return f"---\n{yaml.safe_dump(content, sort_keys=False)}---\n"


def _identity(facts: Facts) -> str:
    manifest, recipe = facts.manifest, facts.recipe
    size = sum(entry.size for entry in manifest.files.values())
    rows = (
        ("id", f"`{recipe.id}`"),
        ("task", f"`{recipe.spec.task}` version {recipe.spec.version}"),
        ("tier", recipe.tier),
        ("joint steps", f"{manifest.n_steps:,}"),
        ("episodes", f"{manifest.n_episodes:,}"),
        ("size", f"{size / 1e6:,.1f} MB"),
        ("digest of the arrays", f"`{manifest.digest}`"),
        ("recipe", f"`{manifest.recipe_hash}`"),
        ("format version", str(manifest.format_version)),
    )
    snippet = f'```python\nimport swarmdata\n\ndataset = swarmdata.load("{recipe.id}")\n```\n'
    return f"\n# {recipe.id}\n\n{snippet}\n" + markdown.table(("", ""), rows)


def _splits(facts: Facts) -> str:
    table, rule = facts.table, facts.recipe.splits
    rows = []
    for code, name in enumerate(SPLITS):
        chosen = table.split == code
        mean = f"{table.team_return[chosen].mean():.3f}" if chosen.any() else "none"
        rows.append((name, f"{chosen.sum():,}", f"{table.lengths[chosen].sum():,}", mean))
    return (
        "\n## Splits\n\n"
        + markdown.table(("split", "episodes", "steps", "mean return"), rows)
        + f"\nBy episode and by policy: of every {rule.block} consecutive episodes of a policy, "
        f"{rule.validation} is for validation and {rule.test} for test. Normalization statistics "
        "come from train only. Evaluation seeds are reserved and never occur in a dataset.\n"
    )


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
    )


def check(facts: Facts) -> tuple[str, ...]:
    """Returns what holds of this dataset.

    Raises:
        SchemaError: naming what does not hold.
    """
    table, spec = facts.table, facts.recipe.spec
    claims = {
        "No episode has a reserved evaluation seed.": (table.seeds < EVALUATION_BASE).all(),
        "No seed occurs twice.": len(np.unique(table.seeds)) == len(table),
        "No episode is longer than the horizon.": (table.lengths <= spec.horizon).all(),
        "Every episode that was not solved or failed has the horizon's length.": (
            table.lengths[table.end_reason == END_REASONS.index("horizon")] == spec.horizon
        ).all(),
        "Every return is finite.": np.isfinite(table.team_return).all(),
        "The dataset has the steps of its recipe.": facts.manifest.n_steps >= facts.recipe.n_steps,
    }
    broken = [claim for claim, holds in claims.items() if not holds]
    if broken:
        raise SchemaError(f"{facts.recipe.id} fails its checks: {' '.join(broken)}")
    return tuple(claims)


def _rebuild(facts: Facts) -> str:
    made = ", ".join(f"{name} {value}" for name, value in sorted(facts.manifest.provenance.items()))
    return (
        "\n## Rebuild\n\n    swarmdata generate recipe.json --out FOLDER\n\n"
        "makes this dataset again from the recipe beside this card, on any machine and with any "
        f"number of workers, with the digest above. This copy was made with {made}.\n"
    )


def _bullets(title: str, lines: Sequence[str]) -> str:
    return f"\n## {title}\n\n" + "".join(f"- {line}\n" for line in lines)


def _interval(interval: Interval | None) -> str:
    if interval is None:
        return "never"
    return f"{interval.value:.3f} [{interval.low:.3f}, {interval.high:.3f}]"
