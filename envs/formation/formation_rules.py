"""The rules of `formation`: shape, path of the reference, and reward weights."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from swarmdata.specs.frozen import Probability
from swarmdata.specs.quantities import Distance, Duration, Length, Speed, Weight
from swarmdata.specs.rules import Rewards, TaskDemand, TaskRules

if TYPE_CHECKING:
    from swarmdata.specs.task_spec import TaskSpec


Previews = Annotated[tuple[Duration, ...], Field(max_length=64)]

PATH_CHECK_STEPS = 4  # control steps between checked places of a path


class FormationRewards(Rewards):
    """Weights of `formation`."""

    deviation: Weight = 0.05  # per step and metre of distance to the own slot, up to 1 m
    velocity: Weight = 0.01  # per step in the slot and m/s of difference to its velocity


class FormationRules(TaskRules):
    """`formation`: robots reach and hold a shape whose reference moves through the arena."""

    card_limits: ClassVar[tuple[str, ...]] = (
        "Robots know where their slots will be a moment later (`preview`); the reference does "
        "not wait for robots that fall behind.",
        "An episode ends as soon as the shape has been held long enough, so good episodes are "
        "shorter and contribute fewer late steps.",
    )

    task: Literal["formation"] = "formation"
    shape: Literal["line", "circle", "wedge", "column"] = "wedge"  # of the slots
    spacing: Length = 0.5  # m between neighbouring slots
    slots: Literal["fixed", "assigned"] = "assigned"  # assigned: the best assignment in each step
    reference_speed: Speed = 0.28  # m/s, never exceeded
    segment_time: Duration = 4.0  # s between the control points of the path
    max_turn: Annotated[float, Field(ge=0, le=1.2)] = 0.8  # rad from one control edge to the next
    path_clearance: Distance = 0.3  # m, from the reference's path to every obstacle
    blocked: tuple[Probability, Probability] = (0.1, 0.3)  # share of time with a slot in obstacles
    start_spread: Distance = 1.0  # m beyond the slots in which robots start
    preview: Previews = (1.0, 2.0)  # s ahead at which robots see their slots
    tolerance: Length = 0.12  # m, root mean square deviation that counts as in formation
    hold_fraction: Annotated[float, Field(gt=0, le=1)] = 0.6  # of the horizon in formation to solve
    rewards: FormationRewards = FormationRewards.defaults()  # weights of the terms

    @property
    def has_own_targets(self) -> bool:
        return self.slots == "fixed"

    def demand(self, spec: "TaskSpec") -> TaskDemand:
        n, m, previews = spec.n_agents, spec.obstacles.number, len(self.preview)
        duration = spec.horizon * spec.control_dt + max(self.preview, default=0.0)
        points = int(duration / self.segment_time) + 4
        looks = max(float(spec.horizon), self.segment_time / spec.control_dt) / PATH_CHECK_STEPS + 1
        return TaskDemand(
            features=8 + 2 * previews,
            columns=2 * points + n * (4 + 2 * previews),
            is_matched=self.slots == "assigned",
            attempt_nanoseconds=looks * (100.0 + 6.0 * n * m + 10.0 * m),
        )
