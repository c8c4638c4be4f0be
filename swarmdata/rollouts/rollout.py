"""Runs a policy in the copies of a task and yields the finished episodes, in the order of seeds."""

from collections.abc import Callable, Iterator

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.interfaces import Policy, VecEnv
from swarmdata.types import (
    END_REASONS,
    STATE_FIELDS,
    STEP_FIELDS,
    Bool,
    Episode,
    Float,
    Int,
    Seeds,
    Step,
)

_SUCCESS, _FAILURE, _HORIZON = (END_REASONS.index(r) for r in ("success", "failure", "horizon"))
_NO_EPISODE = -1  # position of a copy that runs no wanted episode


def rollout(
    env: VecEnv,
    policy: Policy,
    seeds: Seeds,
    *,
    policy_index: int = 0,
    progress: Callable[[int], object] | None = None,
) -> Iterator[Episode]:
    """Runs one episode per seed and yields them in the order of `seeds`.

    Each copy takes the next seed when its episode has ended. Episodes that finish before their turn
    wait in memory. Every episode is the same bits for any number of copies. With fewer seeds than
    copies, the surplus copies repeat seeds and their episodes are dropped.

    Args:
        env: copies of a task; all of them are reset.
        policy: chooses the joint actions, float32 [E, N, A].
        seeds: episode seeds, uint64 [n_episodes]; may be empty.
        policy_index: stored as `Episode.policy`.
        progress: called with the number of episodes that have just finished (`tqdm.update` fits).

    Returns:
        An iterator of `len(seeds)` episodes; their arrays are the caller's.

    Raises:
        SchemaError: `seeds` is not uint64 [n], the policy's actions are not float32 [E, N, A] or
            their log-probabilities not float32 [E, N], or an episode outlives the horizon of its
            spec.
    """
    if seeds.dtype != np.uint64 or seeds.ndim != 1:
        raise SchemaError(
            f"seeds are {seeds.dtype} {list(seeds.shape)}, expected uint64 [n_episodes]. "
            "Use seeding.evaluation_seeds or np.asarray(seeds, np.uint64)."
        )
    return _in_order(_run(env, policy, seeds, policy_index), progress)


def _in_order(
    finished: Iterator[tuple[int, Episode]], progress: Callable[[int], object] | None
) -> Iterator[Episode]:
    """Sorts (position, episode) pairs by position, holding back those that are early."""
    waiting: dict[int, Episode] = {}
    wanted = 0
    for position, episode in finished:
        if progress is not None:
            progress(1)
        waiting[position] = episode
        while wanted in waiting:
            yield waiting.pop(wanted)
            wanted += 1


def _run(
    env: VecEnv, policy: Policy, seeds: Seeds, policy_index: int
) -> Iterator[tuple[int, Episode]]:
    """Yields (position in `seeds`, episode) as episodes finish."""
    if not len(seeds):
        return
    n_copies = env.n_copies
    queued = min(n_copies, len(seeds))
    positions = np.where(np.arange(n_copies) < queued, np.arange(n_copies), _NO_EPISODE)
    step = env.reset(np.resize(seeds, n_copies))
    policy.reset(step, np.arange(n_copies))
    ring = EpisodeRing(env, step)
    ring.write_start(step)
    while (wanted := positions != _NO_EPISODE).any():
        step = ring.advance(env, policy, step, wanted)
        ended = np.flatnonzero(step.ended & wanted)
        for copy in ended:
            yield int(positions[copy]), ring.cut(int(copy), step, policy_index)
        n_new = min(len(ended), len(seeds) - queued)
        fresh, positions[ended[n_new:]] = ended[:n_new], _NO_EPISODE
        if n_new:
            positions[fresh] = np.arange(queued, queued + n_new)
            step = env.reset(seeds[queued : queued + n_new], fresh)
            policy.reset(step, fresh)
            ring.write_start(step, fresh)
            queued += n_new


class EpisodeRing:
    """The last `horizon + 1` steps of all copies, as rings that share one write position.

    One clock for all copies makes each write one contiguous assignment; a copy's episode is the
    rows from where it started to where it ended, around the ring.
    """

    def __init__(self, env: VecEnv, step: Step) -> None:
        self.n_rows = R = env.spec.horizon + 1
        self.row = 0
        E = env.n_copies
        self.starts: Int = np.zeros(E, np.int64)  # row of each copy's first observation
        self.lengths: Int = np.zeros(E, np.int64)  # steps recorded since then
        actions = np.empty((*step.rewards.shape, env.action_size), np.float32)
        like = {**step._asdict(), "actions": actions, "log_probs": step.rewards}
        self.rows = {
            name: np.empty((R, *like[name].shape), like[name].dtype)
            for name in (*STATE_FIELDS, *STEP_FIELDS)
        }

    def write_start(self, step: Step, copies: Int | slice = slice(None)) -> None:
        """Begins an episode in `copies` at the current row; their older rows are given up."""
        for name in STATE_FIELDS:
            self.rows[name][self.row, copies] = getattr(step, name)[copies]
        self.starts[copies] = self.row
        self.lengths[copies] = 0

    def advance(self, env: VecEnv, policy: Policy, step: Step, wanted: Bool) -> Step:
        """Lets the policy act once in all copies; the rows of copies not `wanted` [E] are noise."""
        actions = policy.act(step)
        self._write(policy, "act", "actions", actions)
        self._write(policy, "log_probs", "log_probs", policy.log_probs(step, actions))
        step = env.step(actions)
        for name in STEP_FIELDS[2:]:
            self.rows[name][self.row] = getattr(step, name)
        self.row = (self.row + 1) % self.n_rows
        for name in STATE_FIELDS:
            self.rows[name][self.row] = getattr(step, name)
        self.lengths += 1
        self._check_horizon(step, wanted)
        return step

    def _write(self, policy: Policy, method: str, name: str, values: Float) -> None:
        """Records what a policy said of the current step.

        Raises:
            SchemaError: the values are of another dtype or shape.
        """
        expected = self.rows[name].shape[1:]
        if values.dtype != np.float32 or values.shape != expected:
            raise SchemaError(
                f"{type(policy).__name__}.{method} returned {values.dtype} {list(values.shape)}, "
                f"expected float32 {list(expected)} (copies, agents"
                f"{', action size' if name == 'actions' else ''})."
            )
        self.rows[name][self.row] = values

    def _check_horizon(self, step: Step, wanted: Bool) -> None:
        """Raises before the ring would overwrite the beginning of an episode that goes on."""
        late = (self.lengths >= self.n_rows - 1) & ~step.ended & wanted
        if late.any():
            raise SchemaError(
                f"the episode of seed {step.seeds[late][0]} goes on after {self.n_rows - 1} steps, "
                "the horizon of its spec. The task must set `truncations` by then."
            )

    def cut(self, copy: int, step: Step, policy_index: int) -> Episode:
        """Copies out the episode that `step` has ended in one copy."""
        length = int(self.lengths[copy])
        rows = (self.starts[copy] + np.arange(length + 1)) % self.n_rows
        failure_or_horizon = _FAILURE if step.terminations[copy] else _HORIZON
        return Episode(
            **{name: self.rows[name][rows, copy] for name in STATE_FIELDS},
            **{name: self.rows[name][rows[:-1], copy] for name in STEP_FIELDS},
            layout=step.layouts[copy].copy(),
            seed=int(step.seeds[copy]),
            policy=policy_index,
            end_reason=_SUCCESS if step.successes[copy] else failure_or_horizon,
        )
