"""Published datasets and the measured reference policies of each task, from the package.

A test has checked every number of these files, so they are read as they are.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Self, TypeVar

from swarmdata.errors import SchemaError

if TYPE_CHECKING:
    from swarmdata.specs.origins import Origin, SideSpec
    from swarmdata.specs.task_spec import TaskSpec
    from swarmdata.types import Double

Returns = TypeVar("Returns", float, "Double")
V = TypeVar("V")


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
    return {
        name: {metric: None if each is None else Interval(**each) for metric, each in row.items()}
        for name, row in table.items()
    }


PACKAGE_LICENSE = "cc-by-4.0"  # of the datasets that the package publishes, whose recipes name none


def license_of(origin: "Origin") -> str:
    """The Hub's name of a dataset's license: its author's, or the package's; else `unknown`.

    An edit of datasets that the package publishes has the package's.
    """
    known, parents = published(), origin.parents
    is_ours = origin.id in known or (
        parents
        and all(each.id in known and each.digest == known[each.id].digest for each in parents)
    )
    return PACKAGE_LICENSE if is_ours and origin.license == "unknown" else origin.license


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


REFERENCE_OPPONENTS = "scripted"
"""Who plays the other sides where the references of a side are measured."""


def side_specs(spec: "TaskSpec") -> dict[str, "SideSpec"]:
    """What the references of each side of a task are of, by its name; none if it has one side."""
    from swarmdata.specs.origins import SideSpec  # noqa: PLC0415  (rarely needed)

    names = [side.name for side in spec.sides] if len(spec.sides) > 1 else []
    return {name: SideSpec(whole=spec, side=name, opponents=REFERENCE_OPPONENTS) for name in names}


def side_references(spec: "TaskSpec") -> dict[str, TaskReferences]:
    """The references of each side of a task that has several, by its name, where measured."""
    found = {name: references_of(side.hash()) for name, side in side_specs(spec).items()}
    return {name: known for name, known in found.items() if known is not None}


@cache
def _read(name: str) -> dict[str, dict[str, object]]:
    data: dict[str, dict[str, object]] = json.loads(_text(name))
    return data


@cache
def _text(name: str) -> str:
    # from the package's folder: nothing of the folder with the cards is imported
    return (files("swarmdata") / "cards" / name).read_text(encoding="utf-8")
