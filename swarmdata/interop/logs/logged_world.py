"""A world that plays logged motion back, so that a task's own code observes and scores it.

The robots go where they were logged, whatever their commands; contacts are found from positions by
the rules of the simulated worlds, after every physics step.
"""

from typing import Any, NamedTuple

import numpy as np

from swarmdata.envs.coop_nav.unassigned_goals import share_goals
from swarmdata.envs.physics.backend import Contacts, Plan
from swarmdata.envs.physics.contacts import update_contacts
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.interfaces import Task
from swarmdata.specs.rules import NavigationRules
from swarmdata.specs.state_layout import TX, UY, X, robots_of
from swarmdata.types import Bool, Counts, Double, Float, Int, Seeds


class LoggedMotion(NamedTuple):
    """The motion of N robots in an episode of T steps, with P physics steps in each."""

    places: Double  # [T, P, N, 2] m, positions after each physics step
    robots: Double  # [T + 1, N, 6] x, y, vx, vy, ux, uy of each state
    goals: Double  # [N, 2] m
    layout: Float  # [M, 8] obstacles, columns `geometry.OBSTACLE`


class LoggedWorld:
    """One copy of a task in which logged motion is played back.

    Args:
        task: whose code observes and scores.
    """

    def __init__(self, task: Task) -> None:
        self._start = _LoggedStart(task)
        self._backend: _Playback | None = None
        self.env = TaskEnv(self._start, 1, backend=self._make_backend)  # type: ignore[arg-type]

    def begin(self, motion: LoggedMotion) -> None:
        """Takes the motion that the next episode of `env` plays back."""
        assert self._backend is not None
        self._start.motion = self._backend.motion = motion

    def _make_backend(self, plan: Plan, n_copies: int) -> "_Playback":
        self._backend = _Playback(plan)
        return self._backend


class _LoggedStart:
    """A task whose episodes start where the robots were logged; the rest is the task's."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self.motion: LoggedMotion | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._task, name)

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        assert self.motion is not None
        robots = robots_of(states, self._task.spec.n_agents)
        layouts[0] = self.motion.layout
        robots[0, :, X : UY + 1] = self.motion.robots[0]
        robots[0, :, TX:] = self.motion.goals
        rules = self._task.spec.rules
        if isinstance(rules, NavigationRules) and rules.goals == "unassigned":
            share_goals(states, copies, self._task.spec.n_agents, rules.goal_radius)


class _Playback:
    """Implements `Backend` for one copy: positions are those of a motion, not of commands."""

    def __init__(self, plan: Plan) -> None:
        self._radii: Double = np.array([robot.radius for robot in plan.spec.robots])
        self._half: Double = np.array(plan.spec.half_size)
        self._layout: Float = np.zeros((len(plan.kinds), 8), np.float32)
        self._t = 0
        self.motion: LoggedMotion | None = None

    def reset(
        self,
        copies: Int,
        layouts: Float,
        robots: Double,
        bodies: Double,
        limits: Double,
        payloads: Double,
    ) -> None:
        self._layout, self._t = layouts[0].copy(), 0

    def step(
        self, active: Bool, commands: Double, contacts: Contacts, events: Counts, states: Float
    ) -> None:
        assert self.motion is not None
        if not active[0]:
            return
        for places in self.motion.places[self._t]:
            update_contacts(
                np.ascontiguousarray(places), self._radii, self._layout, self._half,
                contacts.robots[0], contacts.obstacles[0], contacts.slack[0], events[0],
            )  # fmt: skip
        self._t += 1
        robots = robots_of(states, len(self._radii))
        robots[0, :, X : UY + 1] = self.motion.robots[self._t]
