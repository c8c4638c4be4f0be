"""Origin, the protocol of everything a dataset can come from, and the table of its kinds."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol, Self

from swarmdata.errors import SpecError
from swarmdata.runtime.own_components import import_component
from swarmdata.specs.frozen import Document
from swarmdata.specs.origins.spec_kinds import Spec
from swarmdata.specs.recipe import PolicySource, Recipe, SplitRule
from swarmdata.specs.task_spec import TaskSpec

if TYPE_CHECKING:
    from swarmdata.specs.origins.edit_origin import Parent


class Origin(Document, Protocol):
    """Where a dataset comes from; its JSON is the content of `recipe.json`."""

    @property
    def kind(self) -> str: ...  # its key in `ORIGIN_KINDS`
    @property
    def id(self) -> str: ...  # versioned name of the dataset, such as `coop_nav-medium-v1`
    @property
    def tier(self) -> str: ...  # name of what kind of data it is, such as `medium`
    @property
    def spec(self) -> Spec: ...  # what was recorded
    @property
    def policies(self) -> tuple[PolicySource, ...]: ...  # `episodes/policy` has their indices
    @property
    def recipe(self) -> Recipe | None:
        """The recipe that generates the dataset bit for bit, None where no recipe does.

        A dataset with a recipe has every array, and all its claims can be checked against it.
        """
        ...

    @property
    def can_rebuild(self) -> bool: ...  # whether lost files are made again, by recipe or parents
    @property
    def missing(self) -> str | None:
        """What it names and nothing installed here defines, and what to do; None: nothing."""
        ...

    @property
    def parents(self) -> "tuple[Parent, ...]": ...  # the datasets that it was made from, if any
    @property
    def split_rule(self) -> SplitRule | None: ...  # None: episodes keep the splits of their source
    @property
    def has_world_seeds(self) -> bool: ...  # whether each seed gives the world of its episode
    @property
    def source(self) -> str: ...  # what made the episodes, or the format they were converted from
    @property
    def source_sha256(self) -> str | None: ...  # of the file that was converted, if there was one
    @property
    def remaking(self) -> str | None:
        """How its source gives it again, for a card; None where a recipe does, or nothing."""
        ...

    @property
    def license(self) -> str: ...  # as the Hugging Face Hub names it; `unknown` if none was given
    @property
    def metadata(self) -> Mapping[str, str] | None: ...  # of its author; None: nobody is asked
    @property
    def about_tier(self) -> str | None:
        """What a card says of the tier; None for the description of the package's tiers."""
        ...

    def to_yaml(self) -> str: ...  # the same content as readable YAML
    @classmethod
    def parse(cls, data: Any, source: str = "") -> Self:
        """Builds it from plain data.

        Raises:
            SpecError: one message naming the path of every wrong key or value.
        """
        ...


ORIGIN_KINDS: dict[str, "str | type[Origin]"] = {
    "recipe": "swarmdata.specs.recipe:Recipe",
    "recording": "swarmdata.specs.origins.recording_origin:Recording",
    "edit": "swarmdata.specs.origins.edit_origin:Edit",
    "logs": "swarmdata.specs.origins.log_origin:ImportedLogs",
}
"""Every kind of origin by its `kind`, "module:Name" or the class; a recipe's JSON has none."""


def parse_origin(data: Any, source: str) -> Origin:
    """Builds the origin from the content of a `recipe.json`; without a `kind` it is a recipe.

    Raises:
        SpecError: it is malformed.
    """
    kind = data.get("kind") if isinstance(data, Mapping) else None
    known = kind if isinstance(kind, str) and kind in ORIGIN_KINDS else "recipe"
    model: type[Origin] = import_component(ORIGIN_KINDS[known])
    TaskSpec.model_rebuild()  # first, so that models with a spec take over what it has built
    return model.parse(data, source)


def check_installed(origin: Origin, purpose: str) -> None:
    """Checks that all that a dataset names is defined here, which `purpose` needs.

    Raises:
        SpecError: another package defines some of it.
    """
    if origin.missing is not None:
        raise SpecError(f"{origin.id}: {purpose} needs {origin.missing}.")


def task_of(origin: Origin, purpose: str) -> TaskSpec:
    """The spec of a dataset of a task of this library, which `purpose`, such as "coverage", needs.

    Raises:
        SpecError: the dataset was recorded in another environment, or another package defines its
            task, which is not installed.
    """
    check_installed(origin, purpose)
    world = origin.spec.world
    if world is None:
        raise SpecError(
            f"{origin.id} was recorded in {origin.spec.task}, an environment of "
            f"{origin.spec.library or 'another library'}; {purpose} needs a task of swarmdata."
        )
    return world
