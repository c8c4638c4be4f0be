"""The rules of `pursuit`: evaders, what captures them, what robots see, and reward weights."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, Literal

from swarmdata.specs.quantities import Count, Length, Ratio, Weight
from swarmdata.specs.rules import CrowdedRewards, TaskDemand, TaskRules

if TYPE_CHECKING:
    from swarmdata.specs.task_spec import TaskSpec

EvaderName = Literal[
    "lookahead", "all_seeing", "two_models", "wide_margin", "far_lookahead", "short_sight"
]
"""How evaders flee: a key of `evader.EVADERS`."""


class PursuitRewards(CrowdedRewards):
    """Weights of `pursuit`."""

    progress: Weight = 0.5  # per metre by which a robot comes closer to an evader that it knows
    capture: Weight = 3.0  # to every robot, per evader that is captured


class PursuitRules(TaskRules):
    """`pursuit`: robots capture evaders that are faster, by being at each together."""

    card_limits: ClassVar[tuple[str, ...]] = (
        "Evaders move at their speed at once, without inertia; they are no bodies of the physics, "
        "and keep out of obstacles and, where they can, of robots.",
        "Evaders follow one fixed rule, which does not learn.",
        "Robots measure places and velocities of the evaders that they see exactly, and remember "
        "them for 5 s.",
    )
    naive_teams: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "pursuit-greedy": "each robot drives straight at the nearest evader",
            "pursuit-lead-1": "each robot aims up to 1 s ahead of it",
            "pursuit-lead-3": "each robot aims up to 3 s ahead of it",
            "pursuit-lead-mixed": "robots aim 0 s, up to 1 s and up to 3 s ahead of it, in turn",
        }
    )

    task: Literal["pursuit"] = "pursuit"
    evaders: Count = 1  # to capture
    captors: Count = 3  # robots that capture an evader, at the same time
    capture_radius: Length = 0.45  # m between centres, within which robots capture an evader
    speed_ratio: Ratio = 2.0  # evaders' speed over that of the fastest robot
    evader_radius: Length = 0.1  # m
    evader: EvaderName = "lookahead"  # how evaders flee
    sight_range: Length | None = None  # m, within which robots see evaders; None: everywhere
    start_size: Length = 1.0  # m, side of the square in a corner in which robots start
    rewards: PursuitRewards = PursuitRewards.defaults()  # weights of the terms

    def demand(self, spec: "TaskSpec") -> TaskDemand:
        memory = 0 if self.sight_range is None else 6 * spec.n_agents
        return TaskDemand(columns=(8 + memory) * self.evaders, features=24 + 8 * self.evaders)
