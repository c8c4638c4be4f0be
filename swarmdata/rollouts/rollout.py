"""Runs a policy in the copies of a task and yields the finished episodes in the order of seeds."""

from collections.abc import Callable, Iterator

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.interfaces import Policy, VecEnv, check_acts
from swarmdata.numerics.random import checked_seeds
from swarmdata.runtime.native_libraries import ThreadLimit
from swarmdata.types import (
    END_REASONS,
    STATE_FIELDS,
    STEP_FIELDS,
    Bool,
    Counts,
    Episode,
    Float,
    Int,
    Seeds,
    Step,
)

_SUCCESS, _FAILURE, _HORIZON = (END_REASONS.index(r) for r in ("success", "failure", "horizon"))
_NO_EPISODE = -1  # the position of a copy whose episode is not wanted


def end_reasons(step: Step) -> Counts:
    """Why the episodes end that have `step` as their last one, indices into END_REASONS, [E]."""
    unsolved = np.where(step.terminations, _FAILURE, _HORIZON)
    return np.where(step.successes, _SUCCESS, unsolved).astype(np.uint8)


def rollout(
    env: VecEnv,
    policy: Policy,
    seeds: Seeds,
    *,
    policy_index: int = 0,
    policy_threads: int = 1,
    progress: Callable[[int], object] | None = None,
) -> Iterator[Episode]:
    """Runs one episode per seed and yields them in the order of `seeds`.

    Each copy takes the next seed when its episode has ended. Episodes that finish before their turn
    wait in memory. Every episode has the same bits for any number of copies. With fewer seeds than
    copies, the surplus copies repeat seeds and their episodes are dropped.

    Args:
        env: copies of a task; all of them are reset.
        policy: chooses the joint actions, float32 [E, N, A].
        seeds: of the episodes, [n_episodes]; may be empty.
        policy_index: stored as `Episode.policy`.
        policy_threads: threads of the policy's matrix products, see `ThreadLimit`.
        progress: called with the number of episodes that have just finished, as `tqdm.update` is.

    Returns:
        An iterator over `len(seeds)` episodes, whose arrays belong to the caller.

    Raises:
        SchemaError: `seeds` are no whole numbers, the policy lacks a method, its actions are not
            float32 [E, N, A], their log-probabilities are not float32 [E, N], or an episode runs
            beyond the horizon of its spec.
    """
    check_acts(policy, "reset", "act", "log_probs")
    return _run(
        env, policy, checked_seeds(seeds), policy_index, ThreadLimit(policy_threads), progress
    )


def _run(
    env: VecEnv,
    policy: Policy,
    seeds: Seeds,
    policy_index: int,
    limit: ThreadLimit,
    progress: Callable[[int], object] | None,
) -> Iterator[Episode]:
    """Runs the episodes and yields them in order; those that finish early wait in `finished`."""
    if not len(seeds):
        return
    n_copies, n_yielded = env.n_copies, 0
    finished: dict[int, Episode] = {}  # by position in `seeds`
    n_started = min(n_copies, len(seeds))
    positions = np.where(np.arange(n_copies) < n_started, np.arange(n_copies), _NO_EPISODE)
    step = env.reset(np.resize(seeds, n_copies))
    policy.reset(step, np.arange(n_copies))
    ring = EpisodeRing(env, step)
    ring.write_start(step)
    while (wanted := positions != _NO_EPISODE).any():
        ended = np.empty(0, np.int64)
        with limit:  # not while the caller works on an episode
            while not len(ended):
                step = ring.advance(env, policy, step, wanted)
                ended = np.flatnonzero(step.ended & wanted)
        for copy in ended.tolist():
            finished[int(positions[copy])] = ring.cut(copy, step, policy_index)
            if progress is not None:
                progress(1)
        while n_yielded in finished:
            yield finished.pop(n_yielded)
            n_yielded += 1
        n_new = min(len(ended), len(seeds) - n_started)
        restarted, positions[ended[n_new:]] = ended[:n_new], _NO_EPISODE
        if n_new:
            positions[restarted] = np.arange(n_started, n_started + n_new)
            step = env.reset(seeds[n_started : n_started + n_new], restarted)
            policy.reset(step, restarted)
            ring.write_start(step, restarted)
            n_started += n_new


class EpisodeRing:
    """The last `horizon + 1` steps of all copies, in ring buffers that share one write position.

    A copy's episode is the rows from its first observation to its last, around the ring. Rows of a
    copy are neighbors, so that its episode is read in one piece.
    """

    def __init__(self, env: VecEnv, step: Step) -> None:
        self.n_rows = R = env.spec.horizon + 1
        self.row = 0
        E = env.n_copies
        self.starts: Int = np.zeros(E, np.int64)  # row of each copy's first observation
        self.lengths: Int = np.zeros(E, np.int64)  # steps recorded since then
        actions = np.empty((*step.rewards.shape, env.action_size), np.float32)
        like = {**step._asdict(), "actions": actions, "log_probs": step.rewards}
        terms = ("reward_terms",) if step.reward_terms.shape[2] else ()
        self.step_fields = (*STEP_FIELDS, *terms)
        self.rows = {
            name: np.empty((E, R, *like[name].shape[1:]), like[name].dtype)
            for name in (*STATE_FIELDS, *self.step_fields)
        }

    def write_start(self, step: Step, copies: Int | slice = slice(None)) -> None:
        """Begins an episode in `copies` at the current row; their older rows are discarded."""
        for name in STATE_FIELDS:
            self.rows[name][copies, self.row] = getattr(step, name)[copies]
        self.starts[copies] = self.row
        self.lengths[copies] = 0

    def advance(self, env: VecEnv, policy: Policy, step: Step, wanted: Bool) -> Step:
        """Lets the policy act once in all copies, and records the step; returns the next one.

        The episodes of `wanted` copies, [E], are kept; the rows of the others mean nothing.
        """
        actions = policy.act(step)
        self._write(policy, "act", "actions", actions)
        self._write(policy, "log_probs", "log_probs", policy.log_probs(step, actions))
        step = env.step(actions)
        for name in self.step_fields[2:]:
            self.rows[name][:, self.row] = getattr(step, name)
        self.row = (self.row + 1) % self.n_rows
        for name in STATE_FIELDS:
            self.rows[name][:, self.row] = getattr(step, name)
        self.lengths += 1
        late = (self.lengths >= self.n_rows - 1) & ~step.ended & wanted
        if late.any():
            raise SchemaError(
                f"the episode of seed {step.seeds[late][0]} goes on after {self.n_rows - 1} steps, "
                "the horizon of its spec. The task must set `truncations` by then."
            )
        return step

    def _write(self, policy: Policy, method: str, name: str, values: Float) -> None:
        """Records what a method of the policy returned for the current step."""
        row = self.rows[name][:, self.row]
        if values.dtype != np.float32 or values.shape != row.shape:
            raise SchemaError(
                f"{type(policy).__name__}.{method} returned {values.dtype} {list(values.shape)}, "
                f"expected float32 {list(row.shape)} (copies, agents"
                f"{', action size' if name == 'actions' else ''})."
            )
        row[...] = values

    def cut(self, copy: int, step: Step, policy_index: int) -> Episode:
        """Returns the episode that has ended with `step` in one copy."""
        length = int(self.lengths[copy])
        rows = (self.starts[copy] + np.arange(length + 1)) % self.n_rows
        return Episode(
            **{name: self.rows[name][copy].take(rows, axis=0) for name in STATE_FIELDS},
            **{name: self.rows[name][copy].take(rows[:-1], axis=0) for name in self.step_fields},
            layout=step.layouts[copy].copy(),
            seed=int(step.seeds[copy]),
            policy=policy_index,
            end_reason=int(end_reasons(step)[copy]),
        )
