"""The part of a spec that only one task has: what all rules share, and where each task's are."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, Union

from pydantic import (
    GetJsonSchemaHandler,
    SerializeAsAny,
    TypeAdapter,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic_core import InitErrorDetails, PydanticKnownError

from swarmdata.errors import UnknownNameError, check_type
from swarmdata.runtime.own_components import components, import_component
from swarmdata.specs.frozen import Frozen, Probability
from swarmdata.specs.quantities import Force, Length, Mass, Weight

if TYPE_CHECKING:
    from swarmdata.specs.task_spec import TaskSpec


PACKAGE_RULES: Mapping[str, str] = {
    "coop_nav": "swarmdata.envs.coop_nav.navigation_rules:NavigationRules",
    "formation": "swarmdata.envs.formation.formation_rules:FormationRules",
    "transport": "swarmdata.envs.transport.transport_rules:TransportRules",
    "warehouse": "swarmdata.envs.warehouse.warehouse_rules:WarehouseRules",
    "intersection": "swarmdata.envs.intersection.intersection_rules:IntersectionRules",
    "search": "swarmdata.envs.search.search_rules:SearchRules",
    "pursuit": "swarmdata.envs.pursuit.pursuit_rules:PursuitRules",
    "tag": "swarmdata.envs.tag.tag_rules:TagRules",
}
"""The model of the rules of each task of the package; a user's task has its own as `Rules`."""


class Rewards(Frozen):
    """Reward weights that all tasks share; each task adds those of its own terms."""

    success: Weight = 3.0  # once, to every robot, when the task is solved
    time: Weight = 0.02  # per step in which the robot has not done its part
    robot_contact: Weight = 0.4  # per step in contact with a robot
    obstacle_contact: Weight = 0.4  # per step in contact with an obstacle or wall
    robot_collision: Weight = 1.0  # per contact with a robot that begins
    obstacle_collision: Weight = 1.0  # per contact with an obstacle or wall that begins
    proximity: Weight = 0.05  # per step, times how deep in the last 0.1 m before contact
    team_share: Probability = 0.0  # part of each reward that is the mean over the team, or side


class CrowdedRewards(Rewards):
    """The same where robots that meet in an aisle or at a target cannot keep 0.1 m apart."""

    robot_contact: Weight = 0.2
    obstacle_contact: Weight = 0.2
    robot_collision: Weight = 0.5
    obstacle_collision: Weight = 0.5
    proximity: Weight = 0.005


def changed_weights(weights: Rewards, changes: Mapping[str, float | str]) -> Rewards:
    """Returns the same weights with some of them changed.

    Raises:
        UnknownNameError: there is no weight of that name; the message lists those that exist.
        SpecError: a weight cannot have the value.
    """
    for name in changes:
        if name not in type(weights).model_fields:
            raise UnknownNameError("reward weight", name, type(weights).model_fields)
    return type(weights).parse({**weights.model_dump(), **changes}, "rewards")


def words_of_rewards(changes: Mapping[str, Any]) -> str:
    """What makes rewards others than the recorded ones, in words: robot_collision 2, time 0.5."""
    if "function" in changes:
        return f"function {changes['function']}"
    return ", ".join(f"{name} {value:g}" for name, value in changes.items())


class Payload(Frozen):
    """A rigid body that slides on the floor and turns."""

    shape: Literal["circle", "box"] = "circle"  # a box has faces and can be turned
    half_length: Length = 0.35  # radius of a circle
    half_width: Length = 0.25  # m, of a box
    mass: Mass = 4.0  # kg
    friction: Force = 2.5  # N, of the floor; one robot pushes with mass 1 kg times acceleration
    friction_limit: Literal["separate", "ellipsoid"] = "separate"  # of force and torque, in Pymunk

    later_fields: ClassVar[tuple[str, ...]] = ("friction_limit",)


class Side(NamedTuple):
    """Robots that share a reward, against others."""

    name: str  # such as "pursuers"
    agents: range  # their indices, consecutive


class TaskDemand(NamedTuple):
    """What a task adds to the demand of a world (`specs.budget`), rather too much."""

    columns: int  # of a state, beside those of robots
    obstacles: int = 0  # of every layout, beside those that `Obstacles` counts
    places: int = 0  # where goods are picked or delivered
    features: int = 24  # of a robot's observation
    is_matched: bool = False  # robots are assigned to targets in every step
    is_drawn: bool = True  # layouts are drawn at random
    attempt_nanoseconds: float = 0.0  # of a failed attempt to draw one, beside places


class TaskRules(Frozen):
    """The rules of a task: models of tasks derive from it, with fields `task` and `rewards`.

    Attributes:
        payload_field: the field with the `Payload` that robots push; None: they push nothing.
        card_limits: known limits of all datasets of the task, whole sentences for their cards.
        naive_teams: registered policies of this task alone whose robots do not act together, and
            what they do; its reference tables compare the scripted team with them.
        side_names: names of the sides, in the order of `sides`; most tasks have one.
    """

    payload_field: ClassVar[str | None] = None
    card_limits: ClassVar[tuple[str, ...]] = ()
    naive_teams: ClassVar[Mapping[str, str]] = MappingProxyType({})
    side_names: ClassVar[tuple[str, ...]] = ("team",)

    if TYPE_CHECKING:  # not fields here, so that those of each task keep their order
        task: str
        rewards: Rewards

    @property
    def conventions(self) -> tuple[str, ...]:
        """Names of the conventions that scripted teams can keep in this task."""
        return ()

    @property
    def has_own_targets(self) -> bool:
        """Whether each robot has a target that the other robots do not change."""
        return False

    def sides(self, spec: "TaskSpec") -> tuple[Side, ...]:
        """The sides of a spec, whose rules these are; together they are all robots, in agent order.

        The first side succeeds where the task is solved, the others where an episode ends unsolved.
        """
        return (Side(self.side_names[0], range(spec.n_agents)),)

    def demand(self, spec: "TaskSpec") -> TaskDemand:
        """What the task adds to the demand of the world of a spec, whose rules these are."""
        return TaskDemand(columns=16 + 6 * spec.n_agents)


def rules_model(task: str) -> type[TaskRules]:
    """The model of the rules of a task.

    Raises:
        UnknownNameError: no task has this name.
        ValueError: a user's task has no such model as its `Rules`.
    """
    if task in PACKAGE_RULES:
        return import_component(PACKAGE_RULES[task])
    own = components("tasks")
    if task not in own:
        raise UnknownNameError("task", task, (*PACKAGE_RULES, *own))
    model = getattr(import_component(own[task]), "Rules", None)
    if not (isinstance(model, type) and issubclass(model, TaskRules)):
        raise ValueError(
            f"the attribute `Rules` of task {task!r} is {model!r}, expected a model that derives "
            "from swarmdata.specs.rules.TaskRules"
        )
    return model


def _read_rules(value: Any, read: ValidatorFunctionWrapHandler) -> Any:
    """Reads rules with the model of their task alone; problems are at `rules.TASK.FIELD`."""
    if not isinstance(value, Mapping):
        return read(value)
    task = value.get("task")
    if task is None:
        raise PydanticKnownError("union_tag_not_found", {"discriminator": "'task'"})
    try:
        model = rules_model(str(task))
    except UnknownNameError:
        known = ", ".join(map(repr, (*PACKAGE_RULES, *components("tasks"))))
        found = {"discriminator": "'task'", "tag": str(task), "expected_tags": known}
        raise PydanticKnownError("union_tag_invalid", found) from None
    try:
        return model.model_validate(value)
    except ValidationError as error:
        raise ValidationError.from_exception_data(
            error.title, list(_located(str(task), error))
        ) from None


def _located(task: str, error: ValidationError) -> Iterator[InitErrorDetails]:
    """The problems of rules, each with the task as the first part of its place."""
    for each in error.errors(include_url=False):
        found = InitErrorDetails(type=each["type"], loc=(task, *each["loc"]), input=each["input"])
        yield InitErrorDetails(**found, ctx=each["ctx"]) if "ctx" in each else found


class _SchemaOfEach:
    """The JSON schema of rules: that of any task of the package."""

    def __get_pydantic_json_schema__(self, _: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        models = tuple(map(rules_model, PACKAGE_RULES))
        union: Any = Union[models]  # noqa: UP007  (built here)
        return handler(TypeAdapter(union).core_schema)


Rules = Annotated[SerializeAsAny[TaskRules], WrapValidator(_read_rules), _SchemaOfEach()]
"""The rules of one of the package's tasks, or of a task that users have registered."""


RewardChoice = Mapping[str, float | str] | str
"""New weights of rewards by name, the name of a set of them, or a function as "module:name"."""

SAFE_FACTOR = 5.0
"""What `safe` multiplies the weight `proximity` by, the one term that is felt before a contact."""


def chosen_weights(choice: RewardChoice, rules: TaskRules) -> dict[str, float | str]:
    """Returns new weights by name: those that are given, or of the set `safe` or `team`.

    Raises:
        UnknownNameError: there is no such set.
        SchemaError: it is neither a name nor a mapping.
    """
    if not isinstance(choice, str):
        advice = "Dataset.with_rewards takes functions."
        check_type("rewards", choice, Mapping, "weights by name, or the name of a set", advice)
        return dict(choice)
    if choice == "team":
        return {"team_share": 1.0}
    if choice != "safe":
        raise UnknownNameError("set of reward weights", choice, ("safe", "team"))
    return {"proximity": SAFE_FACTOR * rules.rewards.proximity}
