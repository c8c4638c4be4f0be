"""A block of copies of a task that one thread steps: physics, task rules, then observation."""

import numpy as np

from swarmdata.envs.physics.backend import Plan
from swarmdata.envs.world.step_buffer import clear_copies, keep_ended
from swarmdata.envs.world.world import SCORING, MakeBackend, Scoring, World, score_steps
from swarmdata.interfaces import Task
from swarmdata.perception.observer import Observer
from swarmdata.registry.components import reward_terms
from swarmdata.runtime.argument_blocks import ArgumentBlock
from swarmdata.specs.state_layout import state_size
from swarmdata.types import Bool, Double, Float, Int, Seeds, Step


class CopyBlock:
    """E copies that read one step and write the next, into arrays that belong to the caller.

    Nothing in it is shared with another block, so blocks may work at the same time.

    Args:
        task: used by no other block, since tasks may have scratch memory.
        n_copies: E.
        backend: builds the physics.
    """

    def __init__(self, task: Task, n_copies: int, backend: MakeBackend) -> None:
        self.task, self.n_copies = task, n_copies
        spec = task.spec
        self._world = World(Plan(spec, task.kinds, task.movables), n_copies, backend)
        self._observer = Observer(task, n_copies)
        self.features = self._observer.features
        self.state_size = state_size(spec.n_agents, len(task.movables), len(task.extras))
        self._solved: Bool = np.zeros(n_copies, dtype=np.bool_)
        weights = np.array([term.signed_weight for term in reward_terms(task)])
        self._n_terms = len(weights)
        scoring = Scoring(
            radii=self._world.radii,
            half=self._world.half,
            weights=weights,
            team_share=spec.rules.rewards.team_share,
            is_fatal=spec.on_collision == "fail",
            horizon=spec.horizon,
            solved=self._solved,
            slack=self._world.contacts.slack,
            active=self._world.active,
        )
        self._scoring = ArgumentBlock(scoring, SCORING)

    def spawn(self, seeds: Seeds, copies: Int, now: Step) -> None:
        """Draws episodes into the layouts and states of a step; the worlds stay as they are.

        Raises:
            SpawnError: no collision-free layout was found.
        """
        self.task.spawn(seeds, copies, now.layouts, now.states)

    def start(self, seeds: Seeds, copies: Int, now: Step) -> None:
        """Starts the worlds of the episodes that `spawn` has drawn, and observes them."""
        self._world.reset(copies, seeds, now.layouts, now.states)
        fresh = np.zeros(self.n_copies, dtype=np.bool_)
        clear_copies(
            copies, seeds, now.seeds, now.times, now.rewards, now.reward_terms, now.events,
            now.terminations, now.truncations, now.successes, fresh,
        )  # fmt: skip
        self._observer.observe(now, None, fresh, copies)

    def begin(self, actions: Float | Double, before: Step, now: Step) -> int:
        """Takes actions over; returns what `World.begin` does. The worlds stay as they are."""
        return self._world.begin(actions, before, now)

    def finish(self, actions: Float | Double, before: Step, now: Step, n_active: int) -> None:
        """Completes the step that has begun with `n_active` copies that had not ended."""
        active = self._world.active
        self._world.advance(now)
        if n_active < self.n_copies:
            keep_ended(before, now, active)
        self.task.update(before, now, active, self._solved)
        score_steps(
            self._scoring.packed, now.states, now.layouts, now.events, now.times,
            now.reward_terms, now.rewards, now.terminations, now.truncations, now.successes,
        )  # fmt: skip
        self._observer.observe(now, actions, active)

    def blank(self, n_copies: int) -> Step:
        """Returns a step of `n_copies` copies in which nothing has happened."""
        e, n = n_copies, self.task.spec.n_agents
        observations, sent, delivered, ages = self._observer.allocate((e,), n)
        return Step(
            observations=observations,
            states=np.zeros((e, self.state_size), dtype=np.float32),
            rewards=np.zeros((e, n), dtype=np.float32),
            reward_terms=np.zeros((e, n, self._n_terms), dtype=np.float32),
            terminations=np.zeros(e, dtype=np.bool_),
            truncations=np.zeros(e, dtype=np.bool_),
            successes=np.zeros(e, dtype=np.bool_),
            events=np.zeros((e, n, 4), dtype=np.uint8),
            seeds=np.zeros(e, dtype=np.uint64),
            times=np.zeros(e, dtype=np.int64),
            layouts=np.zeros((e, len(self.task.kinds), 8), dtype=np.float32),
            sent=sent,
            delivered=delivered,
            ages=ages,
        )
