"""The scripted sides of `tag`, and pursuers that do not act together.

Pursuers do what they do in `pursuit`. The evader is a robot here: it wants the velocity of the rule
of the evaders there (`envs.pursuit.evader`), and its drive follows.
"""

from typing import ClassVar

import numpy as np

from swarmdata.behavior_policies.navigation.velocity_tracking import command_of
from swarmdata.behavior_policies.noise import Controller
from swarmdata.behavior_policies.pursuit.pursuit_controller import Greedy as GreedyPursuit
from swarmdata.behavior_policies.pursuit.pursuit_controller import LeadThree as LeadPursuit
from swarmdata.behavior_policies.pursuit.pursuit_controller import PursuitController
from swarmdata.envs.physics.dynamics import limits_of
from swarmdata.envs.pursuit.evader import N_HEADINGS, EvaderModel, evade, random_bits
from swarmdata.envs.pursuit.pursuit import Pursuit, places_of
from swarmdata.envs.pursuit.pursuit_rules import PursuitRules
from swarmdata.envs.tag.tag import pursuit_of
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, UX, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float, Int, Seeds, Step

CLEARANCE = 0.03  # m that the evader keeps from obstacles and robots: it cannot stop at once


@kernel
def flee(
    seeds: Seeds,  # [E] of the episodes
    times: Int,  # [E] control steps
    states: Float,  # [E, S]
    layouts: Float,  # [E, M, 8] obstacles
    model: EvaderModel,  # of the evader
    radii: Double,  # [N - 1] of the pursuers, m
    limit: Double,  # [9] of the evader, a row of `dynamics.limits_of`
    are_alarmed: Bool,  # [E] changed
    headings: Double,  # [E, 2] in which they wander, changed
    out: Double,  # [E, 2] written, in [-1, 1]
) -> None:
    """Writes the commands of the evaders of all copies."""
    n, nothing = radii.shape[0], np.empty((0, 4))
    for b in range(states.shape[0]):
        robots, e, layout = places_of(states[b], n), N_COLUMNS * n, layouts[b]
        place = (np.float64(states[b, e]), np.float64(states[b, e + 1]))
        are_alarmed[b], headings[b, 0], headings[b, 1], x, y = evade(
            place, (headings[b, 0], headings[b, 1]), are_alarmed[b],
            random_bits(seeds[b], times[b], 0), robots, robots, radii, layout, model,
        )  # fmt: skip
        wish = ((x - place[0]) / model.dt, (y - place[1]) / model.dt)
        velocity = (np.float64(states[b, e + VX]), np.float64(states[b, e + VY]))
        facing = (np.float64(states[b, e + UX]), np.float64(states[b, e + UX + 1]))
        command_of(velocity, facing, wish, limit, nothing, 0, model.dt, out[b])


class TagController(Controller):
    """Both scripted sides; it knows the map and all robots (`step.layouts`, `step.states`).

    Arguments and errors are those of `Scripted`; a spec of another task is refused too.
    """

    pursuers: ClassVar[type[PursuitController]] = PursuitController

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        super().__init__(spec, noise)
        chase = pursuit_of(spec)
        task, rules = Pursuit(chase), chase.rules_as(PursuitRules)
        self._columns, self._pursuers = task.columns, self.pursuers(chase)
        model = EvaderModel.of(chase, rules)
        self._model = model._replace(radius=model.radius + CLEARANCE)
        self._radii: Double = np.array([robot.radius for robot in chase.robots])
        self._limit: Double = limits_of(spec)[-1]
        self._are_alarmed: Bool = np.zeros(0, dtype=np.bool_)
        self._headings: Double = np.zeros((0, 2))

    def reset(self, step: Step, copies: Int) -> None:
        super().reset(step, copies)
        self._pursuers.reset(self._as_pursuit(step), copies)
        if len(step.seeds) != len(self._are_alarmed):
            self._are_alarmed = np.zeros(len(step.seeds), dtype=np.bool_)
            self._headings = np.zeros((len(step.seeds), 2))
        self._are_alarmed[copies] = False
        drawn = [int(random_bits(seed, 0, 1)) % N_HEADINGS for seed in step.seeds[copies]]
        self._headings[copies] = self._model.headings[drawn]

    def commands(self, step: Step) -> Double:
        commands: Double = np.empty((len(step.seeds), len(self._radii) + 1, 2))
        commands[:, :-1] = self._pursuers.commands(self._as_pursuit(step))
        evaders: Double = np.empty((len(step.seeds), 2))
        flee(
            step.seeds, step.times, step.states, step.layouts, self._model, self._radii,
            self._limit, self._are_alarmed, self._headings, evaders,
        )  # fmt: skip
        commands[:, -1] = evaders
        return commands

    def _as_pursuit(self, step: Step) -> Step:
        """The same step with states of `pursuit`, in which the evader is no robot."""
        n, c = len(self._radii), self._columns
        states: Float = np.zeros((len(step.states), c.headings + 2), dtype=np.float32)
        states[:, : c.places] = step.states[:, : c.places]
        evader = robots_of(step.states, n + 1)[:, n]
        states[:, c.places : c.captured] = evader[:, X : Y + 1]
        states[:, c.velocities : c.alarmed] = evader[:, VX : VY + 1]
        return step._replace(states=states)


class Greedy(TagController):
    """Every pursuer drives straight at the evader, which is the scripted one."""

    pursuers = GreedyPursuit


class LeadThree(TagController):
    """Every pursuer aims up to 3 s ahead of the evader, which is the scripted one."""

    pursuers = LeadPursuit
