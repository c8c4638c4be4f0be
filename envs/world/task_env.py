"""TaskEnv: E copies of any task, stepped by one thread or by several."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import partial
from itertools import pairwise
from threading import Barrier
from typing import Any

import numpy as np

from swarmdata.envs.physics.backend import Plan
from swarmdata.envs.world.world import (
    SCORING,
    MakeBackend,
    Scoring,
    World,
    make_backend,
    score_steps,
)
from swarmdata.errors import SchemaError
from swarmdata.interfaces import Task
from swarmdata.numerics.random import checked_seeds
from swarmdata.perception.observer import Observer
from swarmdata.registry.components import reward_terms
from swarmdata.runtime.argument_blocks import ArgumentBlock
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import state_size
from swarmdata.types import Bool, Counts, Double, Float, Int, Seeds, Step, blank_step


class CopyBlock:
    """E copies that read one step and write the next, into arrays that belong to the caller.

    Nothing in it, its task included, is shared with another block, so blocks may work at the same
    time.
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
            bounds=np.array(spec.side_bounds, dtype=np.int64),
            is_fatal=spec.on_collision == "fail",
            horizon=spec.horizon,
            solved=self._solved,
            slack=self._world.contacts.slack,
            active=self._world.active,
        )
        self._scoring = ArgumentBlock(scoring, SCORING)

    def compile_physics(self, blank: Step) -> None:
        nothing = np.arange(0)
        self._world.reset(nothing, nothing.astype(np.uint64), blank.layouts, blank.states)
        self._world.advance(blank)

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
        """Clips the commands; returns the number of copies that had not ended.

        Raises:
            SchemaError: an action of one of them is not finite; the worlds stay as they are.
        """
        n_active = self._world.begin(actions, before, now)
        if n_active < 0:
            raise SchemaError(
                "an action is NaN or infinite; actions must be finite numbers in [-1, 1]"
            )
        return n_active

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
        return blank_step(
            observations,
            states=np.zeros((e, self.state_size), dtype=np.float32),
            reward_terms=np.zeros((e, n, self._n_terms), dtype=np.float32),
            layouts=np.zeros((e, len(self.task.kinds), 8), dtype=np.float32),
            sent=sent,
            delivered=delivered,
            ages=ages,
        )


class ThreadTeam:
    """Runs up to `size` parts at once: the first in the calling thread, the others in a pool.

    Each part must leave the interpreter for most of its time, as kernels and large array operations
    do. The threads start with the first work, wait without using the processor, and end with
    `close`, with the team, or with the process. After a fork the child starts threads of its own.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._pool: ThreadPoolExecutor | None = None
        self._process = 0  # in which the threads run

    def run(self, parts: Sequence[Callable[[], object]]) -> None:
        """Runs all parts, at most `size`, and returns when the last has finished.

        Raises:
            BaseException: what a part raised, unchanged; of several, that of the first part. It is
                raised once all parts have finished, and so is an interrupt (Ctrl-C).
        """
        if len(parts) == 1:
            parts[0]()
            return
        if self._pool is None or self._process != os.getpid():
            pool, meet = ThreadPoolExecutor(self.size - 1, "swarmdata-step"), Barrier(self.size - 1)
            wait([pool.submit(meet.wait) for _ in range(self.size - 1)])  # all threads are there
            self._pool, self._process = pool, os.getpid()
        try:
            others = [self._pool.submit(part) for part in parts[1:]]
            parts[0]()
            for each in others:
                each.result()
        except BaseException:
            self.close()  # waits for all, also for one that an interrupt has just handed over
            raise

    def close(self) -> None:
        """Ends the threads when they have finished; `run` would start new ones."""
        pool, self._pool = self._pool, None
        if pool is not None and self._process == os.getpid():
            pool.shutdown()


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

    With further tasks, the copies are divided into as many contiguous blocks as there are tasks,
    and each block is stepped by a thread. The bits do not depend on that.

    Args:
        task: the task.
        n_copies: E.
        backend: builds the physics.
        further_tasks: the same task, built once more for each further thread; at most E - 1.
    """

    def __init__(
        self,
        task: Task,
        n_copies: int = 1,
        backend: MakeBackend = make_backend,
        further_tasks: Sequence[Task] = (),
    ) -> None:
        self.task, self.spec, self.n_copies = task, task.spec, n_copies
        tasks = (task, *further_tasks)
        self._edges = [n_copies * k // len(tasks) for k in range(len(tasks) + 1)]
        sizes = (end - first for first, end in pairwise(self._edges))
        self._blocks = [
            CopyBlock(each, size, backend) for each, size in zip(tasks, sizes, strict=True)
        ]
        self.n_threads = len(tasks)
        self._threads = ThreadTeam(self.n_threads)
        first = self._blocks[0]
        self.features = first.features
        self.observation_size, self.action_size = len(self.features), task.spec.action_size
        self.state_size = first.state_size
        self._shape = (n_copies, self.spec.n_agents, self.action_size)
        self._now: Step | None = None
        self._rows: list[Step] = []  # of `_now`, for each block
        self._blank = first.blank(n_copies)
        self._maker = StepMaker(self._blank)

    def __repr__(self) -> str:
        team = f"{self.spec.n_agents} robots, {self.observation_size} features each"
        size = f"{self.n_copies} copies, {team}, at most {self.spec.horizon} steps"
        return f"<{type(self).__name__} {self.spec.task}: {size}>"

    def compile_physics(self) -> None:
        """Compiles or loads the kernels of the physics; to be called before the first reset.

        They take as long as all others together, so another process may begin with those.
        """
        self._blocks[0].compile_physics(self._blank)

    def reset(self, seeds: Seeds, copies: Int | None = None) -> Step:
        """Starts the episodes `seeds` in `copies`; see `interfaces.VecEnv.reset`."""
        chosen = np.arange(self.n_copies) if copies is None else self._chosen(copies)
        seeds = checked_seeds(seeds)
        if seeds.shape != chosen.shape:
            raise SchemaError(
                f"reset got seeds of shape {seeds.shape}, expected {chosen.shape}: "
                "one per reset copy"
            )
        if self._now is None and len(np.unique(chosen)) != self.n_copies:
            raise SchemaError(
                f"the first reset must reset all {self.n_copies} copies, got {len(chosen)}"
            )
        old = self._now if self._now is not None else self._blank
        now = Step._make(array.copy() for array in old)
        rows = self._divide(now)
        resets = list(self._divide_reset(seeds, chosen, rows))
        self._threads.run([partial(block.spawn, *reset) for block, reset in resets])
        self._threads.run([partial(block.start, *reset) for block, reset in resets])
        self._now, self._rows = now, rows
        return now

    def _chosen(self, copies: Int) -> Int:
        """The copies to reset, [C], if they are such."""
        chosen = np.asarray(copies)
        are_numbers = chosen.ndim == 1 and (not chosen.size or chosen.dtype.kind in "iu")
        if not (are_numbers and len(np.unique(chosen)) == len(chosen)) or (
            chosen.size and not 0 <= chosen.min() <= chosen.max() < self.n_copies
        ):
            raise SchemaError(
                f"reset got the copies {copies!r:.100}, expected different whole numbers below "
                f"{self.n_copies}, such as np.flatnonzero(step.ended)"
            )
        return chosen.astype(np.int64)

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
        now = self._maker.after(before)
        rows = self._divide(now)
        if len(rows) == 1:
            block = self._blocks[0]
            block.finish(actions, before, now, block.begin(actions, before, now))
        else:
            parts = []
            for block, old, new, (first, end) in zip(
                self._blocks, self._rows, rows, pairwise(self._edges), strict=True
            ):
                part = actions[first:end], old, new
                parts.append(partial(block.finish, *part, block.begin(*part)))
            self._threads.run(parts)
        self._now, self._rows = now, rows
        return now

    def close(self) -> None:
        self._threads.close()

    def _divide(self, step: Step) -> list[Step]:
        """Returns the rows of each block; they share memory with the step."""
        if len(self._blocks) == 1:
            return [step]
        return [
            Step._make([array[first:end] for array in step]) for first, end in pairwise(self._edges)
        ]

    def _divide_reset(
        self, seeds: Seeds, copies: Int, now: list[Step]
    ) -> Iterator[tuple[CopyBlock, tuple[Seeds, Int, Step]]]:
        """Yields each block that has some of the copies, with its part of them, and its rows."""
        for block, rows, (first, end) in zip(self._blocks, now, pairwise(self._edges), strict=True):
            mine = (first <= copies) & (copies < end)
            if mine.any():
                yield block, (seeds[mine], copies[mine] - first, rows)


WRITTEN_FIELDS = (
    "observations", "states", "rewards", "reward_terms", "terminations", "truncations", "successes",
    "events", "times",
)  # fmt: skip
"""Fields that every step writes from scratch; those of a channel are copied, the others shared."""

LASTING_FIELDS = ("observations", "terminations", "truncations", "successes")
"""Those that `keep_ended` copies where an episode has ended; `begin_step` handles the rest."""

BLOCK_BYTES = 1 << 15  # of steps that are allocated together; keeping one keeps them all

BLOCK_STEPS = 16


class StepMaker:
    """Makes steps with the shapes of another."""

    def __init__(self, like: Step) -> None:
        arrays = [getattr(like, name) for name in WRITTEN_FIELDS]
        self._like = [(array.shape, array.dtype) for array in arrays]
        size = sum(array.nbytes for array in arrays)
        self._n = min(max(BLOCK_BYTES // size, 1), BLOCK_STEPS)
        self._has_channel = like.ages.size > 0
        self._ready: Iterator[tuple[Any, ...]] = iter(())

    def after(self, before: Step) -> Step:
        """Returns a step to fill in; it shares with `before` the fields that only resets change."""
        fresh = next(self._ready, None)
        if fresh is None:
            self._ready = zip(
                *(np.empty((self._n, *shape), dtype) for shape, dtype in self._like), strict=True
            )
            fresh = next(self._ready)
        (
            observations, states, rewards, terms, terminations, truncations, successes, events,
            times,
        ) = fresh  # fmt: skip
        sent, delivered, ages = before.sent, before.delivered, before.ages
        if self._has_channel:
            sent, delivered, ages = sent.copy(), delivered.copy(), ages.copy()
        return Step(
            observations, states, rewards, terms, terminations, truncations, successes, events,
            before.seeds, times, before.layouts, sent, delivered, ages,
        )  # fmt: skip


@kernel
def clear_copies(
    copies: Int,  # [C] rows
    new_seeds: Seeds,  # [C] of the episodes
    seeds: Seeds,  # [E] written
    times: Int,  # [E] written: 0
    rewards: Float,  # [E, N] written: 0
    terms: Float,  # [E, N, R] written: 0
    events: Counts,  # [E, N, 4] written: 0
    terminations: Bool,  # [E] written: false
    truncations: Bool,  # [E] written: false
    successes: Bool,  # [E] written: false
    fresh: Bool,  # [E] written: true
) -> None:
    """Writes the fields of a step that say nothing yet, and `fresh`, where an episode begins."""
    for row in range(copies.shape[0]):
        b = copies[row]
        seeds[b], times[b], fresh[b] = new_seeds[row], 0, True
        rewards[b], terms[b], events[b] = 0.0, 0.0, 0
        terminations[b], truncations[b], successes[b] = False, False, False


def keep_ended(before: Step, now: Step, active: Bool) -> None:
    """Carries the values of `LASTING_FIELDS` over in the copies that had already ended."""
    ended = ~active
    for name in LASTING_FIELDS:
        getattr(now, name)[ended] = getattr(before, name)[ended]
