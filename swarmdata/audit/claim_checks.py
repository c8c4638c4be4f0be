"""Checks of what is said of a dataset: its id, its tier, and its card."""

import json
from importlib.metadata import version

from swarmdata.audit.findings import Remarks, note, problem
from swarmdata.audit.subject import Subject
from swarmdata.behavior_policies.tier_bands import EXPERT_AT_LEAST, MEDIUM_SUCCESS, out_of_band
from swarmdata.behavior_policies.tiers import FAMILY_SPECS
from swarmdata.cards.card import card_of
from swarmdata.cards.reference_file import reference_bytes
from swarmdata.errors import SwarmdataError
from swarmdata.registry.published import (
    TaskReferences,
    changed_versions,
    published,
    references_of,
)
from swarmdata.specs.recipe import Recipe
from swarmdata.store.arrays.attributes import attributes_of
from swarmdata.store.arrays.layout import CARD, REFERENCES, metadata_file
from swarmdata.store.table import clean_successes

LADDER = ("random", "medium", "expert")
"""Tiers in the order of their returns."""

BETWEEN = {"medium-replay": ("random", "medium"), "medium-expert": ("medium", "expert")}
"""Mixtures, and the tiers between which their returns lie."""

NOISE_COST = 0.15
"""Success that a tier may lose in a dataset: action noise, and few episodes. Bands are of policies
without noise on a thousand episodes."""


def identity(subject: Subject) -> Remarks:
    """An id that is published names the published content.

    D4RL's hopper-medium-v1 and -expert-v1 were exchanged by uploading others under the same names
    (issue 76).
    """
    entry = published().get(subject.manifest.id)
    if entry is None:
        return
    if entry.recipe_hash != subject.manifest.recipe_hash:
        yield problem(
            f"{subject.manifest.id} is published of another recipe ({entry.recipe_hash[:12]}, this "
            f"is of {subject.manifest.recipe_hash[:12]}). Give it another id or version."
        )
    elif entry.digest != subject.manifest.digest:
        changed = changed_versions(entry.made_with, subject.manifest.provenance)
        yield note(
            f"the published dataset has digest {entry.digest[:12]}; this was made with "
            f"{', '.join(changed) or 'the same versions'}"
        )


def tiers(subject: Subject) -> Remarks:
    """Returns are ordered random < medium < expert, and the tier's figures are in its band.

    D4RL's hopper-medium-v1 and -expert-v1 were swapped (issue 76), hopper-medium-replay-v1 was
    better than medium (86): both show in the returns.
    """
    origin = subject.origin
    if not isinstance(origin, Recipe):
        yield note("tiers are claims of recipes only; this dataset makes none")
        return
    if origin.tier not in (*LADDER, *BETWEEN):
        return
    known = references_of(origin.spec.hash())
    if known is None:
        yield note("no references are measured for this spec, so its tier is compared with none")
        return
    yield from _rung(subject, origin.tier, known)
    family = next((name for name, spec in FAMILY_SPECS.items() if spec == origin.spec), None)
    if family is not None:
        yield from _bands(subject, family, origin.tier, known)


def _rung(subject: Subject, tier: str, known: TaskReferences) -> Remarks:
    """The dataset's mean return lies nearest to its own tier's, or where its mixture's must."""
    measured = {name: known.mean_return(name) for name in LADDER}
    ladder = {name: value for name, value in measured.items() if value is not None}
    values = list(ladder.values())
    if sorted(values) != values:
        yield problem(f"the measured tiers are out of order: {_listed(ladder)}")
    lacking = sorted({*BETWEEN.get(tier, (tier,))} - ladder.keys())
    if lacking:
        yield note(f"{' and '.join(lacking)} of this spec are not measured: compared with none")
        return
    mean = float(subject.table.team_return.mean())
    if tier in BETWEEN:
        low, high = BETWEEN[tier]
        if not ladder[low] < mean < ladder[high]:
            yield problem(
                f"the mean return {mean:.3f} is not between {low} and {high}: {_listed(ladder)}"
            )
        return
    nearest = min(ladder, key=lambda name: abs(ladder[name] - mean))
    if nearest != tier:
        yield problem(
            f"the mean return {mean:.3f} is that of {nearest}, not of {tier}: {_listed(ladder)}"
        )


def _listed(ladder: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3f}" for name, value in ladder.items())


def _bands(subject: Subject, family: str, tier: str, known: TaskReferences) -> Remarks:
    figures = {
        policy: {name: each.value for name, each in metrics.items() if each is not None}
        for policy, metrics in known.policies.items()
    }
    if {"scripted", "medium", "expert"} <= figures.keys():
        yield from (problem(words) for words in out_of_band(family, figures))
    table = subject.table
    found = {"success": table.success.mean(), "clean_success": clean_successes(table).mean()}
    low, high = MEDIUM_SUCCESS
    if tier == "medium" and not low - NOISE_COST <= found["success"] <= high + NOISE_COST:
        yield problem(
            f"the success of this medium is {found['success']:.3f}, expected {low} to {high}, or "
            f"{NOISE_COST} off with noise"
        )
    for metric, least in EXPERT_AT_LEAST[family].items() if tier == "expert" else ():
        if not found[metric] >= least - NOISE_COST:
            yield problem(
                f"the {metric} of this expert is {found[metric]:.3f}, expected at least {least}, "
                f"or {NOISE_COST} less with noise"
            )


def attributes(subject: Subject) -> Remarks:
    """What Zarr attributes say of columns, units and rewards is what the package writes.

    Who has Zarr and nothing of ours believes them, and no digest of arrays covers them.
    """
    manifest = subject.manifest
    try:
        wanted = attributes_of(subject.origin, {n: e.shape for n, e in manifest.arrays.items()})
    except SwarmdataError as error:
        yield problem(f"no attributes can be made of it: {error}")
        return
    files = {name: subject.path / metadata_file(name) for name in wanted}
    found = {name: json.loads(file.read_bytes()).get("attributes") for name, file in files.items()}
    differing = sorted(name for name in wanted if found[name] != wanted[name])
    if differing and not any(found.values()):
        yield note("its arrays have no Zarr attributes: it was written before there were any")
    elif differing and manifest.provenance.get("swarmdata") != version("swarmdata"):
        yield note(f"Zarr attributes of {differing} are of another version of swarmdata")
    elif differing:
        yield problem(f"Zarr attributes of {differing} were changed: they are not what is written")


def card(subject: Subject) -> Remarks:
    """The card is what its files give: no figure on it is old, or typed by hand.

    OG-MARL's cards are HTML beside the data, with none for its default environment and wrong action
    types; D4RL copied reference scores from v0 to v2 (issue 114).
    """
    path = subject.path / CARD
    if not path.exists():
        remark = problem if isinstance(subject.origin, Recipe) else note  # edits may have none yet
        yield remark(f"there is no {CARD}. Write it with: swarmdata card {subject.path} --write")
        return
    text, wanted = path.read_bytes(), []
    for picture in (None, f"{subject.manifest.id}.png"):  # as generated, and as published
        try:
            wanted.append(card_of(subject.path, picture))
        except SwarmdataError as error:
            yield problem(f"no card can be made of it: {error}")
            return
        if text == wanted[-1].encode():
            break
    else:
        yield problem(_first_difference(text.decode(errors="replace"), wanted[0]))
    yield from _references(subject)


def _references(subject: Subject) -> Remarks:
    """The references for programs are those of the card."""
    wanted = reference_bytes(subject.origin.spec)
    path = subject.path / REFERENCES
    if wanted is not None and (not path.exists() or path.read_bytes() != wanted):
        state = "is not what this version measured" if path.exists() else "is absent"
        yield problem(f"{REFERENCES} {state}. Write it with: swarmdata card {subject.path} --write")


def _first_difference(text: str, wanted: str) -> str:
    got, expected = text.splitlines(keepends=True), wanted.splitlines(keepends=True)
    for number in range(max(len(got), len(expected))):
        pair = [lines[number].rstrip("\n") if number < len(lines) else "nothing"
                for lines in (got, expected)]  # fmt: skip
        if got[number : number + 1] != expected[number : number + 1]:
            break
    return (
        f"{CARD}, line {number + 1}, says {pair[0]!r}, its files say {pair[1]!r}. "
        "Write it again with: swarmdata card --write"
    )
