"""World version 0, which version 1 replaced: what is refused for its specs and ids, and why."""

from swarmdata.errors import ReplacedDatasetError, SpecError
from swarmdata.specs.plain_names import without_version
from swarmdata.specs.task_spec import WORLD_VERSION, TaskSpec

LAST_WITH_VERSION_0 = "swarmdata 0.1 (commit 7a313a1 of the repository)"
"""The last version of the package that simulates worlds of version 0."""

_PRESETS = ("coop_nav", "formation", "transport", "warehouse", "coop_nav-n8", "formation-n8")
_TIERS = ("random", "scripted", "medium", "expert", "medium-expert", "medium-replay")
_NAMES = (
    *(f"{preset}-{tier}" for preset in _PRESETS for tier in _TIERS),
    "coop_nav-mixed-conventions",
    "coop_nav-narrow",
)

REPLACED_IDS = frozenset(f"{name}{size}-v0" for name in _NAMES for size in ("", "-mini"))
"""The ids of the datasets that were shipped as version 0. No other dataset is ever called so."""


def is_simulated(spec: TaskSpec) -> bool:
    """Whether this package simulates the world of a spec; those of older versions it only reads."""
    return spec.version == WORLD_VERSION


def check_world(spec: TaskSpec) -> None:
    """Refuses whatever would simulate a world of a version that is only read.

    Raises:
        SpecError: the spec is of an older version of the world.
    """
    if not is_simulated(spec):
        raise SpecError(
            f"world version {spec.version} was simulated by {LAST_WITH_VERSION_0}, this one "
            f"simulates version {WORLD_VERSION}: use the former to simulate, evaluate or rebuild "
            f"it, or take a dataset or a preset of version {WORLD_VERSION}; recorded data of "
            f"version {spec.version} can still be read and trained on."
        )


def refuse_replaced(name: str) -> None:
    """Refuses the id of a dataset that a newer version has replaced; other names pass.

    Raises:
        ReplacedDatasetError: the id is one of `REPLACED_IDS`; the message says how to get it.
    """
    if name in REPLACED_IDS:
        raise replaced_dataset(name)


def replaced_dataset(name: str) -> ReplacedDatasetError:
    """The error that a dataset of `REPLACED_IDS` is neither built nor looked for here."""
    return ReplacedDatasetError(
        f"{name} was replaced by {without_version(name)}-v{WORLD_VERSION}, because contacts and "
        f"reward terms of the worlds have changed: build it with {LAST_WITH_VERSION_0}, or fetch "
        f"it from a remote that has it with `swarmdata pull {name} --from ADDRESS`."
    )
