"""The recipes of the shipped datasets: for each outline, the policies and their shares."""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from itertools import product
from typing import Annotated

from pydantic import Field

from swarmdata.errors import BuildError, SpecError, UnknownNameError
from swarmdata.registry.presets import preset
from swarmdata.registry.published import LazyTable, published
from swarmdata.registry.tiers import (
    ACTION_NOISE_STD,
    CONVENTION_FAMILIES,
    FAMILIES,
    NEWEST_VERSION,
    STRICT_FAMILIES,
    TIERS,
    Outline,
    checkpoint_index,
    outlines,
)
from swarmdata.specs.frozen import Frozen, NonNegative, Positive
from swarmdata.specs.plain_names import Label, Sha256, without_version
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import TaskSpec

FAMILY_SPECS = LazyTable(FAMILIES, preset)  # the specs of the presets that have datasets, by name


class Checkpoint(Frozen):
    """A file in `behavior_policies/checkpoints`."""

    file: str
    sha256: Sha256
    frames: Annotated[int, Field(ge=1)]  # joint steps of training
    policy: Annotated[int, Field(ge=0)]  # index of the independent training run
    side: Label | None = None  # that it plays, in a task of several
    share: Positive  # of the steps up to medium that it stands for in a replay; 1 elsewhere
    noise: NonNegative | None = None  # standard deviation in training; None for the tier's
    figures: dict[str, float]  # means over the validation episodes


@cache
def checkpoints(family: str, tier: str) -> tuple[Checkpoint, ...]:
    """Returns the shipped checkpoints of a tier of a preset; none if it has not been trained."""
    found = checkpoint_index().get(STRICT_FAMILIES.get(family, family), {}).get(tier, ())
    return tuple(Checkpoint.parse(each, f"checkpoint of {family}-{tier}") for each in found)


def sources(
    family: str, ingredient: str, noise: float | None = None, default: float = ACTION_NOISE_STD
) -> tuple[PolicySource, ...]:
    """Returns the policies of one ingredient of a tier; none if the preset does not have it.

    In a task of several sides, every policy of one plays each of the others; in a replay, those of
    equal progress play each other, and the side with more runs leaves out its last ones.

    Args:
        family: a preset's name.
        ingredient: a registered scripted policy, a tier of the index, or `two-conventions`, which
            is the `expert` too where there are conventions.
        noise: standard deviation of the action noise of learned policies, and of teams with
            conventions; None for that of their training.
        default: standard deviation where the index does not record that of training.
    """
    if ingredient in ("random", "scripted"):
        return (PolicySource(label=ingredient, name=ingredient),)
    if family in CONVENTION_FAMILIES and ingredient in ("two-conventions", "expert"):
        std = default if noise is None else noise
        return tuple(
            PolicySource(label=each, name="scripted", noise=std, convention=each)
            for each in FAMILY_SPECS[family].rules.conventions
        )
    found = checkpoints(family, ingredient)
    if all(each.side is None for each in found):
        return side_sources(family, ingredient, None, noise, default)
    sides = [side.name for side in FAMILY_SPECS[family].sides]
    seats = [side_sources(family, ingredient, side, noise, default) for side in sides]
    teams = zip(*seats, strict=False) if ingredient == "medium-replay" else product(*seats)
    return tuple(against(team, sides, f"{ingredient}-{k}") for k, team in enumerate(teams))


def side_sources(
    family: str,
    ingredient: str,
    side: str | None,
    noise: float | None = None,
    default: float = ACTION_NOISE_STD,
) -> tuple[PolicySource, ...]:
    """Returns the checkpoints of a tier that play a side; None: those of a task that has one side.

    `noise` and `default` are those of `sources`.
    """
    found = []
    known = (each for each in checkpoints(family, ingredient) if each.side == side)
    for index, checkpoint in enumerate(known):
        recorded = default if checkpoint.noise is None else checkpoint.noise
        source = PolicySource(
            label=f"{ingredient}-{index}",
            name="learned",
            checkpoint=checkpoint.file,
            sha256=checkpoint.sha256,
            noise=recorded if noise is None else noise,
            share=_weight(family, ingredient, checkpoint),
        )
        found.append(source)
    return tuple(found)


def against(team: Iterable[PolicySource], sides: Iterable[str], label: str) -> PolicySource:
    """Makes one policy of those that play the sides, with the share of the first."""
    first, *others = team
    _, *names = sides
    opponents = tuple(
        each.model_copy(update={"label": name, "share": 1.0})
        for name, each in zip(names, others, strict=True)
    )
    return first.model_copy(update={"label": label, "opponents": opponents})


def _weight(family: str, ingredient: str, checkpoint: Checkpoint) -> float:
    """Weight of a checkpoint in its group: in a replay, the training steps that it stands for."""
    if ingredient != "medium-replay":
        return checkpoint.share
    run = (checkpoint.side, checkpoint.policy)
    mediums = checkpoints(family, "medium")
    frames = [each.frames for each in mediums if (each.side, each.policy) == run]
    if len(frames) != 1:
        raise BuildError(
            f"checkpoint {checkpoint.file} is of run {checkpoint.policy} of {family}, which has "
            f"{len(frames)} mediums in checkpoints/index.json, expected one. Ship both together."
        )
    return checkpoint.share * frames[0]


def _mix(groups: Sequence[Sequence[PolicySource]]) -> tuple[PolicySource, ...]:
    """Gives every group the same share of the steps; shares within a group stay in proportion."""
    whole = math.lcm(*map(len, groups))  # so that equal shares are whole numbers, which are exact
    mixed = []
    for group in groups:
        total = math.fsum(source.share for source in group)
        is_equal = len({source.share for source in group}) == 1
        for source in group:
            share = whole // len(group) if is_equal else whole * (source.share / total)
            mixed.append(source.model_copy(update={"share": float(share)}))
    return tuple(mixed)


def part_size(spec: TaskSpec, policies: Sequence[PolicySource], n_steps: int) -> int:
    """Returns the number of episodes in a part, a power of two from 4 to 256.

    It is at most half of the episodes that the policy with the least share needs at full length.
    """
    least = min(policy.share for policy in policies) / sum(policy.share for policy in policies)
    wanted = int(n_steps * least / (2 * spec.horizon))
    return 1 << (min(256, max(4, wanted)).bit_length() - 1)


@cache
def shipped_recipes() -> Mapping[str, Recipe]:
    """Returns the shipped recipes by id, with version; each is made when it is first looked at."""
    made_of = outlines()
    return LazyTable(made_of, lambda key: _recipe(key, made_of[key]))


def _recipe(dataset_id: str, outline: Outline) -> Recipe:
    family, name, n_steps = outline
    tier, spec = TIERS[name], FAMILY_SPECS[family]
    groups = [sources(family, each, default=tier.noise) for each in tier.ingredients]
    policies = _mix([group[:1] for group in groups] if tier.first_only else groups)
    return Recipe(
        id=dataset_id,
        tier=name,
        spec=spec,
        policies=policies,
        seed=tier.seed,
        n_steps=n_steps,
        part_episodes=part_size(spec, policies, n_steps),
    )


@cache
def find_recipe(dataset_id: str) -> Recipe:
    """Returns the shipped recipe of an id; without a version, the newest."""
    if not is_dataset(dataset_id):
        raise UnknownNameError("dataset", dataset_id, map(without_version, shipped_recipes()))
    recipes = shipped_recipes()
    return next(recipes[each] for each in versions_of(dataset_id) if each in recipes)


def is_dataset(name: str) -> bool:
    """Whether a shipped recipe has this id, with or without its version."""
    return any(each in shipped_recipes() for each in versions_of(name))


def check_own_id(dataset_id: str) -> None:
    """Raises SpecError for the id of a dataset of the package, which a user's own cannot have."""
    if dataset_id in shipped_recipes() or dataset_id in published():
        raise SpecError(
            f"{dataset_id} is the id of a dataset of the package; choose another, such as "
            "my_task-mine-v0"
        )


def versions_of(name: str) -> tuple[str, str]:
    """The ids that a name may stand for: itself, and with the newest version."""
    return name, f"{name}-v{NEWEST_VERSION}"
