"""TaskEnv: E copies of any task in a world, stepped by physics, task rules, then observation."""

import numpy as np

from swarmdata.envs.physics.backend import Plan
from swarmdata.envs.world.rewards import reward_terms
from swarmdata.envs.world.step_buffer import StepMaker, clear_copies, keep_ended
from swarmdata.envs.world.world import MakeBackend, World, make_backend, score_steps
from swarmdata.errors import SchemaError
from swarmdata.interfaces import Task
from swarmdata.perception.observer import Observer
from swarmdata.specs.state_layout import state_size
from swarmdata.types import Bool, Double, Float, Int, Seeds, Step


class TaskEnv:
    """Implements `interfaces.VecEnv` for any task.

    The terms of the reward of robot i are the task's own and, with [x] one if x holds:

        [solved]   [overlapped a robot]   [overlapped an obstacle]   contacts with robots that began
        contacts with obstacles that began   clip(1 - gap / 0.1 m, 0, 1)

    `rewards.reward_terms` lists them with their weights from `spec.rules.rewards`, and
    `types.EVENT_COLUMNS` defines contacts. `Step.reward_terms` has their values, unweighted.
    `numerics.weighted_terms` computes the rewards from these bit for bit. The values are computed
    from the float32 states and the recorded events, partly in float32: other code reproduces them
    from a dataset within 1e-5 (`store.arrays.attributes.PRECISION_NOTE`).

    An episode is terminated when the task is solved, or by a collision if `on_collision` is "fail";
    the horizon truncates it. A task that is solved and failed in the same step is a failure, but
    its reward includes the success.

    Args:
        task: the task.
        n_copies: E.
        backend: builds the physics.
    """

    def __init__(self, task: Task, n_copies: int = 1, backend: MakeBackend = make_backend) -> None:
        self.task, self.spec, self.n_copies = task, task.spec, n_copies
        spec = task.spec
        self._world = World(Plan(spec, task.kinds, task.movables), n_copies, backend)
        self._observer = Observer(task, n_copies)
        self.features = self._observer.features
        self.observation_size, self.action_size = len(self.features), spec.action_size
        self.state_size = state_size(spec.n_agents, len(task.movables), len(task.extras))
        self._solved: Bool = np.zeros(n_copies, dtype=np.bool_)
        weights = np.array([term.signed_weight for term in reward_terms(task)])
        self._n_terms = len(weights)
        self._scoring = (
            self._world.radii, self._world.half, weights, spec.rules.rewards.team_share,
            spec.on_collision == "fail", spec.horizon, self._solved, self._world.contacts.slack,
        )  # fmt: skip
        self._shape = (n_copies, spec.n_agents, self.action_size)
        self._now: Step | None = None
        self._maker = StepMaker(self._blank())

    def reset(self, seeds: Seeds, copies: Int | None = None) -> Step:
        """Starts the episodes `seeds` in `copies`; see `interfaces.VecEnv.reset`."""
        chosen = np.arange(self.n_copies) if copies is None else np.asarray(copies, dtype=np.int64)
        seeds = np.asarray(seeds, dtype=np.uint64)
        if seeds.shape != chosen.shape:
            raise SchemaError(
                f"reset got seeds of shape {seeds.shape}, expected {chosen.shape}: "
                "one per reset copy"
            )
        if self._now is None and len(np.unique(chosen)) != self.n_copies:
            raise SchemaError(
                f"the first reset must reset all {self.n_copies} copies, got {len(chosen)}"
            )
        old = self._now if self._now is not None else self._blank()
        now = Step._make(array.copy() for array in old)
        self.task.spawn(seeds, chosen, now.layouts, now.states)
        self._world.reset(chosen, now.layouts, now.states)
        fresh = np.zeros(self.n_copies, dtype=np.bool_)
        clear_copies(
            chosen, seeds, now.seeds, now.times, now.rewards, now.reward_terms, now.events,
            now.terminations, now.truncations, now.successes, fresh,
        )  # fmt: skip
        self._observer.observe(now, None, fresh, chosen)
        self._now = now
        return now

    def step(self, actions: Float | Double) -> Step:
        """Advances the copies that have not ended; see `interfaces.VecEnv.step`."""
        before = self._now
        if before is None:
            raise SchemaError("step was called before the first reset; call env.reset(seeds) first")
        actions = np.ascontiguousarray(actions)  # type: ignore[assignment]  # the kind is checked
        if actions.shape != self._shape or actions.dtype.char not in "fd":
            raise SchemaError(
                f"actions are {actions.dtype} {list(actions.shape)}, expected float32 or float64 "
                f"{list(self._shape)} [E, N, A]"
            )
        now, active = self._maker.after(before), self._world.active
        n_active = self._world.step(actions, before, now)
        if n_active < 0:
            raise SchemaError(
                "an action is NaN or infinite; actions must be finite numbers in [-1, 1]"
            )
        if n_active < self.n_copies:
            keep_ended(before, now, active)
        self.task.update(before, now, active, self._solved)
        score_steps(
            *self._scoring, active, now.states, now.layouts, now.events, now.times,
            now.reward_terms, now.rewards, now.terminations, now.truncations, now.successes,
        )  # fmt: skip
        self._observer.observe(now, actions, active)
        self._now = now
        return now

    def close(self) -> None:
        """Does nothing: it holds nothing but memory; see `interfaces.VecEnv.close`."""

    def _blank(self) -> Step:
        e, n = self.n_copies, self.spec.n_agents
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
