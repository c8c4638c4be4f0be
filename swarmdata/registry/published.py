"""Published datasets and the measured reference policies of each task, from the package.

A test has checked every number of these files, so they are read as they are.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.resources import files
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Self, TypeVar

from swarmdata.errors import SchemaError
from swarmdata.specs import WORLD_VERSION

if TYPE_CHECKING:
    from swarmdata.specs.origins import Origin
    from swarmdata.types import Double

Returns = TypeVar("Returns", float, "Double")
V = TypeVar("V")

NEWEST_VERSION = WORLD_VERSION
"""Version of an id that names none: worlds, tiers and ids have one version together."""

N_STEPS, MINI_STEPS = 1_000_000, 50_000

LEARNED_FAMILIES = (
    "coop_nav", "formation", "transport", "warehouse", "coop_nav-n8", "formation-n8",
    "intersection", "search", "pursuit", "coop_nav-corridor-strict", "robotarium",
    "coop_nav-swap-strict", "warehouse-n8",
)  # fmt: skip
"""Presets that have policies of their own."""

SCRIPTED_FAMILIES = tuple(name for name in LEARNED_FAMILIES if name != "pursuit")
"""Those that have scripted data, too; the controller of `pursuit` is slow."""

STRICT_FAMILIES = MappingProxyType(
    {
        f"{name}-strict": name
        for name in ("coop_nav", "coop_nav-n8", "intersection", "search", "warehouse")
    }
)
"""Presets in which a contact ends the episode without success, and those without this rule, whose
policies record their data; other teams than experts hardly ever succeed there."""

CONVENTION_FAMILIES = ("coop_nav-lanes", "coop_nav-ranks")
"""Presets that have datasets of scripted teams with conventions; these teams are their experts."""

FAMILIES = (*LEARNED_FAMILIES, *STRICT_FAMILIES, *CONVENTION_FAMILIES)
"""Presets that have datasets."""

ACTION_NOISE_STD = 0.1
"""Standard deviation of the action noise of learned policies; actions are in [-1, 1]."""


@dataclass(frozen=True)
class Tier:
    """The policies of a tier's datasets."""

    ingredients: tuple[str, ...]  # registered policies or tiers of the index, in equal shares
    seed: int  # of the recipe; it differs from tier to tier, so that tiers share no episode
    noise: float = ACTION_NOISE_STD
    """Standard deviation of the action noise of learned policies, and of teams with conventions; if
    the index records the noise of training, that is used instead."""
    first_only: bool = False  # whether only the first checkpoint of each ingredient is used
    families: tuple[str, ...] = LEARNED_FAMILIES  # presets that have this tier


TIERS = MappingProxyType(
    {
        "random": Tier(("random",), 1),
        "scripted": Tier(("scripted",), 2, families=SCRIPTED_FAMILIES),
        "medium": Tier(("medium",), 3),
        "expert": Tier(("expert",), 4, families=(*LEARNED_FAMILIES, *STRICT_FAMILIES)),
        "medium-expert": Tier(("medium", "expert"), 5),
        "medium-replay": Tier(
            ("medium-replay",), 6, families=(*LEARNED_FAMILIES, *STRICT_FAMILIES)
        ),
        "mixed-conventions": Tier(("mixed-conventions",), 7, noise=0.05, families=("coop_nav",)),
        "narrow": Tier(("expert",), 8, noise=0.02, first_only=True, families=("coop_nav",)),
        "two-conventions": Tier(("two-conventions",), 9, noise=0.05, families=CONVENTION_FAMILIES),
    }
)

TRAINED_TIERS = ("medium", "expert", "medium-replay", "mixed-conventions")
"""Tiers that have checkpoints of their own in the index."""


class Outline(NamedTuple):
    """What a shipped recipe is made of."""

    family: str  # the preset
    tier: str
    n_steps: int


@cache
def outlines() -> Mapping[str, Outline]:
    """Returns what the shipped recipes are made of, by id; tiers without checkpoints are absent."""
    sizes = (("", N_STEPS), ("-mini", MINI_STEPS))
    return {
        f"{family}-{name}{suffix}-v{NEWEST_VERSION}": Outline(family, name, n_steps)
        for name, tier in TIERS.items()
        for family in tier.families
        if all(_has(family, each) for each in tier.ingredients)
        for suffix, n_steps in sizes
    }


def _has(family: str, ingredient: str) -> bool:
    """Whether a preset has the policies of an ingredient."""
    is_scripted = ingredient in ("random", "scripted") or family in CONVENTION_FAMILIES
    known = checkpoint_index().get(STRICT_FAMILIES.get(family, family), {})
    return is_scripted or bool(known.get(ingredient))


@cache
def checkpoint_index() -> dict[str, dict[str, list[dict[str, object]]]]:
    """`checkpoints/index.json`: preset, then tier, then its checkpoints."""
    # from the package's folder: nothing of the folder with the policies is imported
    file = files("swarmdata") / "behavior_policies" / "checkpoints" / "index.json"
    index: dict[str, dict[str, list[dict[str, object]]]] = json.loads(file.read_text("utf-8"))
    return index


class LazyTable(Mapping[str, V], Generic[V]):
    """Values by name; `load` looks at one of a hundred, whose parsing takes its time.

    Args:
        names: in the order of iteration.
        make: returns the value of a name.
    """

    def __init__(self, names: Iterable[str], make: Callable[[str], V]) -> None:
        self._made: dict[str, V | None] = dict.fromkeys(names)
        self._make = make

    def __getitem__(self, name: str) -> V:
        value = self._made[name]
        if value is None:
            value = self._made[name] = self._make(name)
        return value

    def __contains__(self, name: object) -> bool:
        return name in self._made  # without making it

    def __iter__(self) -> Iterator[str]:
        return iter(self._made)

    def __len__(self) -> int:
        return len(self._made)


class Reference(NamedTuple):
    """The two returns between which a score is measured, on the fixed evaluation seeds."""

    no_skill: float  # the better of an idle and a random team
    expert: float


def normalized_score(returns: Returns, reference: Reference) -> Returns:
    """Returns 100 (R - R0) / (R_expert - R0): 0 is no skill, 100 the expert.

    Same shape as `returns`; neither end is clipped.

    Raises:
        SchemaError: the expert is not better than no skill.
    """
    span = reference.expert - reference.no_skill
    if not span > 0:
        raise SchemaError(
            f"reference returns are no_skill={reference.no_skill:g}, expert={reference.expert:g}; "
            "the expert's must be the larger. Measure both on the evaluation seeds of one spec."
        )
    return 100.0 * (returns - reference.no_skill) / span


@dataclass(frozen=True)
class Figures:
    """Sums and means over recorded episodes, action noise included."""

    n_steps: int
    n_episodes: int
    mean_return: float
    success: float
    clean_success: float  # solved without any contact


@dataclass(frozen=True)
class Published(Figures):
    """One published (id, version): what it is made from, what it is, what is in it."""

    task: str
    n_agents: int
    recipe_hash: str  # SHA-256, hex, as the digests
    digest: str  # logical: of names, dtypes, shapes and values of the arrays
    transport_digest: str  # of the files: `Manifest.transport_digest`
    n_bytes: int
    policies: dict[str, Figures]  # by label in the recipe
    made_with: dict[str, str]  # versions and platform

    @classmethod
    def parse(cls, entry: Mapping[str, Any]) -> Self:
        """Reads an entry of `published.json`."""
        policies = {label: Figures(**each) for label, each in entry["policies"].items()}
        return cls(**{**entry, "policies": policies})


@dataclass(frozen=True)
class Interval:
    """A mean over episodes and its 95 % interval."""

    value: float
    low: float
    high: float


GAP_METRICS = ("return", "success", "clean_success")


@dataclass(frozen=True)
class TaskReferences:
    """Measured reference policies of one spec, on the reserved evaluation seeds."""

    spec_hash: str
    n_episodes: int
    made_with: dict[str, str]
    policies: dict[str, dict[str, Interval | None]]  # policy -> metric; None: never defined
    gaps: dict[str, dict[str, Interval]] = field(default_factory=dict)
    """Coordination gaps: by how much the scripted team is better than the same controllers with
    less coordination, by policy and metric of `GAP_METRICS`; paired by episode."""

    @classmethod
    def parse(cls, entry: Mapping[str, Any]) -> Self:
        """Reads an entry of `references.json`."""
        tables = {name: _intervals(entry.get(name, {})) for name in ("policies", "gaps")}
        return cls(**{**entry, **tables})

    @cached_property
    def no_skill(self) -> float | None:
        """Mean return of the better of the idle and the random team; 0 on the score."""
        returns = [self.mean_return(name) for name in ("idle", "random")]
        known = [value for value in returns if value is not None]
        return max(known) if len(known) == len(returns) else None

    @cached_property
    def expert(self) -> float | None:
        """Mean return of the expert team; 100 on the score."""
        return self.mean_return("expert")

    def mean_return(self, policy: str) -> float | None:
        """Mean team return of a reference policy, None if it was not measured."""
        interval = self.policies.get(policy, {}).get("return")
        return interval.value if interval else None

    @property
    def reference(self) -> Reference | None:
        """The ends of the score, None where one of them was not measured."""
        if self.no_skill is None or self.expert is None:
            return None
        return Reference(self.no_skill, self.expert)

    def score(self, team_return: float) -> float | None:
        """The normalized score of a team return, None where a reference was not measured."""
        reference = self.reference
        return None if reference is None else normalized_score(team_return, reference)


def _intervals(table: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The intervals of policies and metrics."""
    return {
        name: {metric: None if each is None else Interval(**each) for metric, each in row.items()}
        for name, row in table.items()
    }


PACKAGE_LICENSE = "cc-by-4.0"
"""Of the datasets that the package publishes, whose recipes name none."""


def license_of(origin: "Origin") -> str:
    """The Hub's name of a dataset's license: its author's, or the package's; else `unknown`."""
    is_published = origin.id in published()
    return PACKAGE_LICENSE if is_published and origin.license == "unknown" else origin.license


def changed_versions(made_with: Mapping[str, str], here: Mapping[str, str]) -> tuple[str, ...]:
    """Describes each difference from the versions and the platform something was made with."""
    return tuple(
        f"{name} {here.get(name, 'none')} instead of {version}"
        for name, version in sorted(made_with.items())
        if here.get(name) != version
    )


@cache
def published() -> Mapping[str, Published]:
    """Every published dataset by its id with version."""
    entries = _read("published.json")
    return LazyTable(entries, lambda key: Published.parse(entries[key]))


@cache
def references() -> Mapping[str, TaskReferences]:
    """Measured references by task."""
    entries = _read("references.json")
    return LazyTable(entries, lambda key: TaskReferences.parse(entries[key]))


@cache
def references_of(spec_hash: str) -> TaskReferences | None:
    """The references measured on exactly this spec, None if there are none.

    Only the text of their entry is parsed: that of all takes 20 ms of a load.
    """
    text = _text("references.json")
    at = text.find(f'"spec_hash": "{spec_hash}"')
    if at < 0:
        return None
    start = text.rindex('\n "', 0, at)  # of the entry: keys of no other level are indented by one
    entry, _ = json.JSONDecoder().raw_decode(text, text.index("{", start))
    return TaskReferences.parse(entry)


@cache
def _read(name: str) -> dict[str, dict[str, object]]:
    data: dict[str, dict[str, object]] = json.loads(_text(name))
    return data


@cache
def _text(name: str) -> str:
    # from the package's folder: nothing of the folder with the cards is imported
    return (files("swarmdata") / "cards" / name).read_text(encoding="utf-8")
