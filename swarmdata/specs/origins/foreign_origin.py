"""ForeignOrigin, of a dataset of which another package defines a part that is not installed."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar, Self

import yaml
from pydantic import TypeAdapter, ValidationError

from swarmdata.errors import SpecError
from swarmdata.runtime.own_components import components, defined_elsewhere
from swarmdata.specs.communication_names import COMMUNICATION_KINDS
from swarmdata.specs.observation_names import OBSERVATION_KINDS
from swarmdata.specs.origins.origin_kinds import ORIGIN_KINDS
from swarmdata.specs.origins.recorded_spec import RecordedAgent, RecordedSpec
from swarmdata.specs.origins.spec_kinds import SPEC_KINDS
from swarmdata.specs.recipe import Policies, PolicySource
from swarmdata.specs.rules import PACKAGE_RULES
from swarmdata.specs.spaces import BoxSpace

_POLICIES: TypeAdapter[tuple[PolicySource, ...]] = TypeAdapter(Policies)

Shapes = Mapping[str, tuple[int, ...]]


@dataclass(frozen=True)
class ForeignOrigin:
    """The content of a `recipe.json` that nothing installed here can read.

    It keeps the protocol `Origin`; its spec is that of a recording with the shapes of the arrays.
    """

    text: str
    id: str
    tier: str
    spec: RecordedSpec
    policies: tuple[PolicySource, ...]
    missing: str

    kind: ClassVar[str] = "foreign"
    recipe: ClassVar[None] = None
    can_rebuild: ClassVar[bool] = False
    parents: ClassVar[tuple[()]] = ()
    split_rule: ClassVar[None] = None
    has_world_seeds: ClassVar[bool] = False
    source_sha256: ClassVar[None] = None
    license: ClassVar[str] = "unknown"
    metadata: ClassVar[None] = None

    @property
    def source(self) -> str:
        return self.missing

    @property
    def remaking(self) -> str:
        return f"This dataset needs {self.missing}."

    @property
    def about_tier(self) -> str:
        return self.remaking

    def hash(self) -> str:
        return hashlib.sha256(self.text.encode()).hexdigest()

    def to_json(self) -> str:
        return self.text

    def to_yaml(self) -> str:
        return yaml.safe_dump(json.loads(self.text), sort_keys=False)

    def model_copy(self, *, update: Mapping[str, Any] | None = None) -> Self:
        return replace(self, **(update or {}))

    @classmethod
    def parse(cls, data: Any, source: str = "") -> Self:
        # `foreign_origin` reads one
        raise SpecError(f"{source} cannot be read without the shapes of its arrays")


def foreign_origin(
    data: Any, text: str, shapes: Shapes, labels: tuple[str, ...], packages: Mapping[str, str]
) -> ForeignOrigin | None:
    """Reads an origin that names something which nothing installed here defines.

    Args:
        data: content of `recipe.json`.
        text: of that file.
        shapes: of the dataset's arrays, by name.
        labels: of its policies, for a kind of origin that is not known.
        packages: that define its parts, as far as the manifest tells: "task thrifty" -> "thrift".

    Returns:
        The origin; None where everything that it names is known, so that it is malformed.
    """
    missing = missing_parts(data, packages)
    if missing is None or not isinstance(data.get("id"), str):
        return None
    tier = data.get("tier")
    return ForeignOrigin(
        text=text,
        id=data["id"],
        tier=tier if isinstance(tier, str) else "unknown",
        spec=_spec_of(data.get("spec"), shapes),
        policies=_policies_of(data.get("policies"), labels),
        missing=missing,
    )


def missing_parts(data: Any, packages: Mapping[str, str] = MappingProxyType({})) -> str | None:
    """What the content of a `recipe.json` names and nothing here defines, and what to do."""
    found = [
        defined_elsewhere(what, name, packages.get(f"{what} {name}", ""))
        for what, name in _unknown_parts(data)
    ]
    return " and ".join(found) or None


def _unknown_parts(data: Any) -> Iterator[tuple[str, str]]:
    """What an origin names and nothing here defines: the kind of part, and its name."""
    if not isinstance(data, Mapping):
        return
    spec = data.get("spec")
    spec = spec if isinstance(spec, Mapping) else {}
    places: tuple[tuple[str, Any, str, Any], ...] = (
        ("origin", data, "kind", ORIGIN_KINDS),
        ("environment", spec, "kind", SPEC_KINDS),
        ("task", spec.get("rules"), "task", {*PACKAGE_RULES, *components("tasks")}),
        ("observation model", spec.get("observation"), "kind", OBSERVATION_KINDS),
        ("communication model", spec.get("communication"), "kind", COMMUNICATION_KINDS),
    )
    for what, place, key, known in places:
        name = place.get(key) if isinstance(place, Mapping) else None
        if isinstance(name, str) and name not in known:
            yield what, name


def _spec_of(spec: Any, shapes: Shapes) -> RecordedSpec:
    """An environment with the task's name, and agents with the columns of the arrays."""
    found = spec if isinstance(spec, Mapping) else {}
    rules = found.get("rules")
    name = rules.get("task") if isinstance(rules, Mapping) else found.get("task")
    n_agents, n_observed = shapes["observations"][1:3]
    names = _agent_names(found.get("team"))
    names = names if len(names) == n_agents else [f"agent_{i}" for i in range(n_agents)]
    low, high = (-1.0, 1.0) if isinstance(rules, Mapping) else (None, None)  # commands of a task
    action = BoxSpace(shape=shapes["actions"][2:], dtype="float32", low=low, high=high)
    observation = BoxSpace(shape=(n_observed,), dtype="float32")
    data = {
        "task": re.sub(r"[^a-z0-9_]+", "_", str(name or "unknown").lower())[:96],
        "agents": [RecordedAgent(name=n, observation=observation, action=action) for n in names],
        "state_size": shapes["states"][1],
        "state_from": "environment",
        "horizon": found.get("horizon"),
        "time_step": found.get("control_dt"),
    }
    try:
        return RecordedSpec.parse(data)
    except SpecError:  # a horizon or a time step that is none
        return RecordedSpec.parse(data | {"horizon": None, "time_step": None})


def _agent_names(team: Any) -> list[str]:
    """The names of a team of robots, such as `robot_0`; none where it is no team."""
    try:
        return [f"{role['name']}_{i}" for role in team for i in range(role["count"])]
    except (TypeError, KeyError):
        return []


def _policies_of(policies: Any, labels: tuple[str, ...]) -> tuple[PolicySource, ...]:
    try:
        return _POLICIES.validate_python(policies)
    except ValidationError:
        return tuple(PolicySource(label=label, name="external") for label in labels)
