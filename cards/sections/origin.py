"""The sections of a card on where the dataset comes from, as the protocol `Origin` says."""

from swarmdata.cards.sections.front_matter import PROPERTIES
from swarmdata.cards.sections.wording import (
    SIDE_TIER_DESCRIPTIONS,
    STRICT_NOTE,
    TIER_DESCRIPTIONS,
    UNKNOWN_TIER_DESCRIPTION,
)
from swarmdata.drawing import markdown
from swarmdata.registry.published import license_of
from swarmdata.registry.recipes import FAMILY_SPECS, is_dataset
from swarmdata.registry.tiers import STRICT_FAMILIES
from swarmdata.specs.origins import Origin
from swarmdata.store import SPLITS, EpisodeTable, Manifest

EXPECTED_METADATA = ("description", "author", "license", "code")  # that authors should state

MOST_NUMBERS = 6  # episode numbers that are listed in full


def tier_section(origin: Origin) -> str:
    """What the tier means."""
    world = origin.spec.world
    of_sides = SIDE_TIER_DESCRIPTIONS if world is not None and len(world.sides) > 1 else {}
    known = {**TIER_DESCRIPTIONS, **of_sides}
    text = origin.about_tier or known.get(origin.tier, UNKNOWN_TIER_DESCRIPTION)
    strict = next((k for k in STRICT_FAMILIES if FAMILY_SPECS[k] == origin.spec), None)
    if strict is not None and is_dataset(origin.id):  # others may record the same task
        text += f" {STRICT_NOTE.format(STRICT_FAMILIES[strict])}"
    return f"\n## Tier\n\n{text}\n"


def about_section(origin: Origin) -> str:
    """What the author states, and what is missing; empty where no author is asked."""
    if origin.metadata is None or (origin.recipe is not None and not origin.metadata):
        return ""
    license = license_of(origin)
    given = {} if license == "unknown" else {"license": license}
    stated = {**given, **origin.metadata}
    rows = [(key, stated.get(key) or "not given") for key in EXPECTED_METADATA]
    rows += [(key, text) for key, text in sorted(stated.items()) if key not in EXPECTED_METADATA]
    return "\n## About\n\n" + markdown.table(PROPERTIES, rows)


def splits_section(table: EpisodeTable, origin: Origin) -> str:
    """How many episodes each split has, and by which rule."""
    rows = []
    for code, name in enumerate(SPLITS):
        chosen = table.split == code
        mean = f"{table.team_return[chosen].mean():.3f}" if chosen.any() else "none"
        rows.append((name, f"{chosen.sum():,}", f"{table.lengths[chosen].sum():,}", mean))
    if origin.split_rule is None:
        source = "its parent dataset" if origin.parents else "the source"
        rule = f"Every episode keeps the split it had in {source}."
    else:
        splits = origin.split_rule.splits
        rule = (
            f"Splits are stratified by policy: of every {splits.block} consecutive episodes of a "
            f"policy, validation gets {splits.validation} and test {splits.test}, chosen at random."
        )
    rule += " The normalization statistics are those of the train split."
    if origin.recipe is not None:
        rule += " The evaluation seeds are reserved: no dataset contains them."
    head = ("split", "episodes", "steps", "mean return")
    return f"\n## Splits\n\n{markdown.table(head, rows)}\n{rule}\n"


def origin_section(origin: Origin, manifest: Manifest) -> str:
    """How the dataset can be made again, or why it cannot."""
    versions = ", ".join(f"{name} {value}" for name, value in sorted(manifest.provenance.items()))
    if origin.recipe is not None:
        return (
            "\n## Rebuild\n\n    swarmdata generate recipe.json --out FOLDER\n\n"
            f"makes this dataset again from the recipe beside this card: {_promise(origin)} This "
            f"copy was made with {versions}.\n"
        )
    if origin.parents:
        rows = []
        for parent in origin.parents:
            numbers = list(map(str, parent.episodes))
            if len(numbers) > MOST_NUMBERS:
                numbers = [*numbers[:3], f"… {numbers[-1]}"]
            names = f"`{parent.id}`", f"`{parent.digest}`"
            rows.append((*names, f"{len(parent.episodes):,}", ", ".join(numbers)))
        head = ("parent", "digest of its arrays", "episodes taken", "their numbers there")
        return (
            "\n## Parents\n\n"
            + markdown.table(head, rows)
            + "\nThe same episodes of the same parents give this dataset again; `recipe.json` "
            f"beside this card lists all of them. This copy was made with {versions}.\n"
        )
    digest = f" (SHA-256 `{origin.source_sha256}`)" if origin.source_sha256 else ""
    kept = origin.remaking or "This dataset cannot be generated again: keep a copy."
    return (
        f"\n## Origin\n\nSource: {origin.source}{digest}. {kept} The files were written with "
        f"{versions}.\n"
    )


def _promise(origin: Origin) -> str:
    inexact = [
        source.label
        for source in origin.policies
        if any(each.name == "network" for each in source.acting)
    ]
    world = origin.spec.world
    if world is not None and world.backend == "mujoco":
        return (
            "the same digest on this machine with these versions, with any number of workers. "
            "Other machines and versions of MuJoCo may give another one."
        )
    if not inexact:
        return "the same digest on any machine, with any number of workers."
    return (
        f"the same episodes of all policies but {', '.join(inexact)}, whose networks cannot be run "
        "exactly. Another machine usually makes the same digest, and does not have to."
    )
