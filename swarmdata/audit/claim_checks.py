"""Checks of claims about a dataset: its id, its tier, its attributes and its card."""

import json
import math
from importlib.metadata import version

from swarmdata.audit.findings import Remarks, note, problem
from swarmdata.audit.subject import Subject
from swarmdata.behavior_policies.tier_bands import EXPERT_AT_LEAST, MEDIUM_SUCCESS, out_of_band
from swarmdata.cards.card import card_of
from swarmdata.cards.references import reference_bytes
from swarmdata.errors import SwarmdataError
from swarmdata.registry.published import TaskReferences, changed_versions, published, references_of
from swarmdata.registry.recipes import FAMILY_SPECS
from swarmdata.registry.tiers import STRICT_FAMILIES
from swarmdata.store.arrays.attributes import attributes_of
from swarmdata.store.arrays.layout import CARD, REFERENCES, metadata_file

TIER_ORDER = ("random", "medium", "expert")  # tiers in the order of their returns

MIXTURE_TIERS = {"medium-replay": ("random", "medium"), "medium-expert": ("medium", "expert")}
"""Mixtures of tiers, whose returns or success rates lie between those of the two: teams may collide
more while they learn to succeed, so returns alone do not tell."""

NOISE_SUCCESS_LOSS = 0.15
"""How far the success of a dataset may lie from its tier's band, because of action noise and few
episodes; bands hold for policies without noise on a thousand episodes. Noise costs large teams most
of their clean success, whose band is checked without it alone."""


def identity(subject: Subject) -> Remarks:
    """A published id belongs to the published content (D4RL issue 76)."""
    entry = published().get(subject.manifest.id)
    if entry is None:
        return
    if entry.recipe_hash != subject.manifest.recipe_hash:
        yield problem(
            f"the published {subject.manifest.id} has recipe {entry.recipe_hash[:12]}, this one "
            f"has {subject.manifest.recipe_hash[:12]}. Give it another id or version."
        )
    elif entry.digest != subject.manifest.digest:
        changed = changed_versions(entry.made_with, subject.manifest.provenance)
        yield note(
            f"the published dataset has digest {entry.digest[:12]}; this was made with "
            f"{', '.join(changed) or 'the same versions'}"
        )


def tiers(subject: Subject) -> Remarks:
    """Returns increase from random over medium to expert, and the tier's figures are in its band.

    So swapped tiers (D4RL issue 76), and a replay above medium (86), are found.
    """
    origin = subject.origin
    if origin.recipe is None:
        yield note("only datasets generated from recipes claim a tier; this one does not")
        return
    if origin.tier not in (*TIER_ORDER, *MIXTURE_TIERS):
        return
    known = references_of(origin.spec.hash())
    if known is None:
        yield note("no references were measured for this spec, so the tier cannot be compared")
        return
    family = next((name for name, spec in FAMILY_SPECS.items() if spec == origin.spec), None)
    if family not in STRICT_FAMILIES:  # whose policies were selected in another preset
        yield from _rung(subject, origin.tier, known)
    if family is not None:
        yield from _bands(subject, family, origin.tier, known)


def _rung(subject: Subject, tier: str, known: TaskReferences) -> Remarks:
    """The mean return is nearest to that of its own tier; a mixture is between its tiers."""
    measured = {name: known.mean_return(name) for name in TIER_ORDER}
    ladder = {name: value for name, value in measured.items() if value is not None}
    values = list(ladder.values())
    if sorted(values) != values:
        yield problem(f"the measured tiers are out of order: {_listed(ladder)}")
    lacking = sorted({*MIXTURE_TIERS.get(tier, (tier,))} - ladder.keys())
    if lacking:
        yield note(f"{' and '.join(lacking)} were not measured for this spec: no comparison")
        return
    mean = float(subject.table.team_return.mean())
    if tier in MIXTURE_TIERS:
        low, high = MIXTURE_TIERS[tier]
        success = subject.table.success.mean()
        is_above = mean > ladder[low] or success > _success(known, low)
        is_below = mean < ladder[high] or success < _success(known, high)
        if not (is_above and is_below):
            yield problem(
                f"the mean return {mean:.3f} is not between {low} and {high}: {_listed(ladder)}"
            )
        return
    nearest = min(ladder, key=lambda name: abs(ladder[name] - mean))
    if nearest != tier:
        yield problem(
            f"the mean return {mean:.3f} is nearest to {nearest}, not to {tier}: {_listed(ladder)}"
        )


def _success(known: TaskReferences, policy: str) -> float:
    """The success rate of a reference policy; NaN, which nothing is above or below, if unknown."""
    interval = known.policies[policy].get("success")
    return interval.value if interval else math.nan


def _listed(ladder: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3f}" for name, value in ladder.items())


def _bands(subject: Subject, family: str, tier: str, known: TaskReferences) -> Remarks:
    figures = {
        policy: {name: each.value for name, each in metrics.items() if each is not None}
        for policy, metrics in known.policies.items()
    }
    if {"idle", "random", "scripted", "medium", "expert"} <= figures.keys():
        for words in out_of_band(family, figures, is_borrowed=family in STRICT_FAMILIES):
            yield problem(words)
    success, (low, high) = subject.table.success.mean(), MEDIUM_SUCCESS
    if (
        tier == "medium"
        and FAMILY_SPECS[family].on_collision == "continue"  # or else noise ends most episodes
        and not low - NOISE_SUCCESS_LOSS <= success <= high + NOISE_SUCCESS_LOSS
    ):
        yield problem(
            f"the success of this medium is {success:.3f}, expected {low} to {high}, or "
            f"{NOISE_SUCCESS_LOSS} off with noise"
        )
    least = EXPERT_AT_LEAST[family]["success"]
    if tier == "expert" and not success >= least - NOISE_SUCCESS_LOSS:
        yield problem(
            f"the success of this expert is {success:.3f}, expected at least {least}, or "
            f"{NOISE_SUCCESS_LOSS} less with noise"
        )


def attributes(subject: Subject) -> Remarks:
    """The Zarr attributes of columns, units and rewards are those that the package writes.

    Readers with Zarr alone rely on them, and no digest of arrays covers them.
    """
    manifest = subject.manifest
    try:
        wanted = attributes_of(subject.origin, {n: e.shape for n, e in manifest.arrays.items()})
    except SwarmdataError as error:
        yield problem(f"its attributes cannot be computed: {error}")
        return
    files = {name: subject.path / metadata_file(name) for name in wanted}
    found = {name: json.loads(file.read_bytes()).get("attributes") for name, file in files.items()}
    differing = sorted(name for name in wanted if found[name] != wanted[name])
    if differing and not any(found.values()):
        yield note("its arrays have no Zarr attributes: an older version of swarmdata wrote it")
    elif differing and manifest.provenance.get("swarmdata") != version("swarmdata"):
        yield note(f"another version of swarmdata wrote the Zarr attributes of {differing}")
    elif differing:
        yield problem(f"the Zarr attributes of {differing} were changed after they were written")


def card(subject: Subject) -> Remarks:
    """The card is the one rendered from the files: no figure is outdated or typed by hand."""
    path = subject.path / CARD
    if not path.exists():
        remark = note if subject.origin.recipe is None else problem  # edits may lack one
        yield remark(f"there is no {CARD}. Write it with: swarmdata card {subject.path} --write")
        return
    text, picture = path.read_bytes(), f"{subject.manifest.id}.png"
    try:  # as generated, and as published
        wanted = card_of(subject.path, None)
        is_right = text == wanted.encode() or text == card_of(subject.path, picture).encode()
    except SwarmdataError as error:
        yield problem(f"its card cannot be rendered: {error}")
        return
    if not is_right:
        yield problem(_first_difference(text.decode(errors="replace"), wanted))
    references, path = reference_bytes(subject.origin.spec), subject.path / REFERENCES
    if references is not None and (not path.exists() or path.read_bytes() != references):
        state = "differs from this version's" if path.exists() else "is absent"
        yield problem(f"{REFERENCES} {state}. Write it with: swarmdata card {subject.path} --write")


def _first_difference(text: str, wanted: str) -> str:
    got, expected = text.splitlines(keepends=True), wanted.splitlines(keepends=True)
    for number in range(max(len(got), len(expected))):
        pair = [lines[number].rstrip("\n") if number < len(lines) else "nothing"
                for lines in (got, expected)]  # fmt: skip
        if got[number : number + 1] != expected[number : number + 1]:
            break
    return (
        f"line {number + 1} of {CARD} is {pair[0]!r}, expected {pair[1]!r} from the files. "
        "Write it again with: swarmdata card --write"
    )
