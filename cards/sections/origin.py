"""The sections of a card that differ with where a dataset comes from: recipe, recording, edit."""

import numpy as np

from swarmdata.cards.sections.wording import TIERS, UNKNOWN_TIER
from swarmdata.drawing import markdown
from swarmdata.specs.origins import Edit, Origin, RecordedSpec, Recording, split_rule
from swarmdata.specs.recipe import Recipe
from swarmdata.store import SPLITS, EpisodeTable, Manifest

OURS = "cc-by-4.0"
"""License of what is made from the package's recipes."""

ASKED = ("description", "author", "license", "code")
"""What every recording should say of itself in its metadata, in the order of the card."""

RECORDED = (
    "Recorded by somebody in an environment, step by step; what the policies are is said below as "
    "far as it was told."
)


def license_of(origin: Origin) -> str:
    """For the Hub's front matter; `unknown` where a recording does not say."""
    if isinstance(origin, Recording):
        return origin.metadata.get("license", "unknown")
    if isinstance(origin, Edit) and isinstance(origin.spec, RecordedSpec):
        return "unknown"
    return OURS


def tier_section(origin: Origin) -> str:
    """What the tier means."""
    if isinstance(origin, Edit):
        text = f"Made by editing other datasets: {origin.operation}. Its parents are named below."
    elif isinstance(origin, Recording):
        text = RECORDED
    else:
        text = TIERS.get(origin.tier, UNKNOWN_TIER)
    return f"\n## Tier\n\n{text}\n"


def about_section(origin: Origin) -> str:
    """What its author says of a recording; what is not said is named. Nothing of other datasets."""
    if not isinstance(origin, Recording):
        return ""
    said = origin.metadata
    rows = [(key, said.get(key) or "not given") for key in ASKED]
    rows += [(key, value) for key, value in sorted(said.items()) if key not in ASKED]
    return "\n## About\n\n" + markdown.table(("", ""), rows)


def splits_section(table: EpisodeTable, origin: Origin) -> str:
    """How many episodes each split has, and by what rule."""
    rows = []
    for code, name in enumerate(SPLITS):
        chosen = table.split == code
        mean = f"{table.team_return[chosen].mean():.3f}" if chosen.any() else "none"
        rows.append((name, f"{chosen.sum():,}", f"{table.lengths[chosen].sum():,}", mean))
    return (
        "\n## Splits\n\n"
        + markdown.table(("split", "episodes", "steps", "mean return"), rows)
        + f"\n{_split_rule(origin)}"
    )


def _split_rule(origin: Origin) -> str:
    if isinstance(origin, Edit):
        return (
            "Every episode has the split that it had in its parent. Normalization statistics come "
            "from train only.\n"
        )
    rule = split_rule(origin)
    if rule is None:
        return (
            "Every episode has the split that it had in the source. Normalization statistics come "
            "from train only.\n"
        )
    text = (
        f"By episode and by policy: of every {rule.block} consecutive episodes of a policy, "
        f"{rule.validation} is for validation and {rule.test} for test. Normalization statistics "
        "come from train only."
    )
    if isinstance(origin, Recording):
        return f"{text}\n"
    return f"{text} Evaluation seeds are reserved and never occur in a dataset.\n"


def origin_section(origin: Origin, manifest: Manifest) -> str:
    """How the dataset can be made again, or why it cannot."""
    made = ", ".join(f"{name} {value}" for name, value in sorted(manifest.provenance.items()))
    if isinstance(origin, Recipe):
        return (
            "\n## Rebuild\n\n    swarmdata generate recipe.json --out FOLDER\n\n"
            "makes this dataset again from the recipe beside this card, on any machine and with "
            f"any number of workers, with the digest above. This copy was made with {made}.\n"
        )
    if isinstance(origin, Edit):
        rows = [
            (f"`{p.id}`", f"`{p.digest}`", f"{len(p.episodes):,}", _episodes(p.episodes))
            for p in origin.parents
        ]
        head = ("parent", "digest of its arrays", "episodes taken", "their numbers in it")
        return (
            "\n## Parents\n\n"
            + markdown.table(head, rows)
            + "\nThe same episodes of the same parents make this dataset again; `recipe.json` "
            f"beside this card has all numbers. This copy was made with {made}.\n"
        )
    digest = f" (SHA-256 `{origin.source_sha256}`)" if origin.source_sha256 else ""
    return (
        f"\n## Origin\n\nFrom: {origin.source}{digest}. A recording cannot be made again: keep a "
        f"copy. The files were written with {made}.\n"
    )


def _episodes(numbers: tuple[int, ...]) -> str:
    """The first and the last numbers, where there are many."""
    if len(numbers) <= 6:
        return ", ".join(map(str, numbers))
    return f"{', '.join(map(str, numbers[:3]))}, … {numbers[-1]}"


def acting(table: EpisodeTable, origin: Origin) -> list[int]:
    """Indices of the policies that made episodes."""
    return [k for k in range(len(origin.policies)) if np.any(table.policy == k)]
