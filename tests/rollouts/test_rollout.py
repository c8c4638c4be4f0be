"""Episodes come out complete, in order, and the same for any number of copies."""

from collections.abc import Callable
from dataclasses import fields

import numpy as np
import pytest

from swarmdata.errors import SchemaError
from swarmdata.interfaces import Task
from swarmdata.numerics.random import derive
from swarmdata.registry.components import make_task
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.features import Feature
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Episode, Float, Int, Seeds, Step, blank_step

HORIZON = 7
N, A = 3, 2
SPEC = TaskSpec(horizon=HORIZON)


class Counting:
    """A world whose arrays say which episode, step and robot they belong to.

    Episode `seed` ends after `1 + seed % HORIZON` steps: by success, failure or the horizon.
    """

    spec = SPEC
    observation_size, action_size, state_size = 4, A, 2

    def __init__(self, n_copies: int, *, endless: bool = False) -> None:
        self.n_copies = n_copies
        self.endless = endless
        self.task: Task = make_task(self.spec)
        self.features: tuple[Feature, ...] = ()
        self.seeds: Seeds = np.zeros(n_copies, np.uint64)
        self.times: Int = np.zeros(n_copies, np.int64)
        self.sums: Float = np.zeros(n_copies, np.float32)
        self.n_resets = 0

    def reset(self, seeds: Seeds, copies: Int | None = None) -> Step:
        copies = np.arange(self.n_copies) if copies is None else copies
        assert len(seeds) == len(copies)
        self.n_resets += len(copies)
        self.seeds[copies] = seeds
        self.times[copies] = 0
        self.sums[copies] = 0
        return self._step(np.zeros((self.n_copies, N), np.float32))

    def close(self) -> None:
        pass

    def step(self, actions: Float | Double) -> Step:
        going = ~self._ended()
        self.times += going
        self.sums += np.where(going, actions.sum((1, 2)), np.float32(0))
        return self._step((actions.sum(2) * going[:, None]).astype(np.float32))

    def _ended(self) -> Bool:
        if self.endless:
            return np.zeros(self.n_copies, np.bool_)
        ended: Bool = self.times >= 1 + self.seeds % np.uint64(HORIZON)
        return ended

    def _step(self, rewards: Float) -> Step:
        ended = self._ended()
        truncated = ended & (self.times == HORIZON)
        terminated = ended & ~truncated
        columns = (self.seeds[:, None], self.times[:, None], np.arange(N), self.sums[:, None])
        events = np.zeros((self.n_copies, N, 4), np.uint8)
        events[..., 0] = self.times[:, None]
        return blank_step(
            np.stack(np.broadcast_arrays(*columns), -1).astype(np.float32),
            np.stack([self.seeds, self.times], 1).astype(np.float32),
            rewards=rewards, terminations=terminated, truncations=truncated, events=events,
            successes=terminated & (self.seeds % np.uint64(2) == 0),
            seeds=self.seeds.copy(), times=self.times.copy(),
            layouts=np.repeat(self.seeds.astype(np.float32), 8).reshape(self.n_copies, 1, 8),
        )  # fmt: skip


class Noisy:
    """Random actions, a function of (seed, time) and of how often the episode was reset."""

    uses_state = False

    def __init__(self, n_copies: int) -> None:
        self.buffer = np.zeros((n_copies, N, A), np.float32)
        self.n_resets = np.zeros(n_copies, np.int64)

    def reset(self, step: Step, copies: Int) -> None:
        assert (step.times[copies] == 0).all()
        self.n_resets[copies] += 1

    def act(self, step: Step) -> Float:
        bits = derive(step.seeds, step.times.astype(np.uint64)) >> np.uint64(40)
        self.buffer[:] = (bits.astype(np.float32) * np.float32(2.0**-24))[:, None, None]
        return self.buffer  # reused on purpose: a recorder must copy

    def log_probs(self, step: Step, actions: Float) -> Float:
        assert actions is self.buffer
        return -actions[..., 0] * (1 + step.times[:, None]).astype(np.float32)


def run(
    seeds: Seeds, n_copies: int, progress: Callable[[int], object] | None = None
) -> list[Episode]:
    env = Counting(n_copies)
    return list(rollout(env, Noisy(n_copies), seeds, policy_index=5, progress=progress))


def same(a: Episode, b: Episode) -> bool:
    return all(
        np.array_equal(getattr(a, f.name), getattr(b, f.name))
        and np.asarray(getattr(a, f.name)).dtype == np.asarray(getattr(b, f.name)).dtype
        for f in fields(Episode)
    )


SEEDS = np.array([3, 6, 0, 13, 5, 1, 2, 8, 4, 20, 9, 27, 10], np.uint64)


@pytest.mark.parametrize("n_copies", [1, 2, 5, 13, 20])
def test_episodes_are_complete_and_in_order(n_copies: int) -> None:
    episodes = run(SEEDS, n_copies)
    assert [e.seed for e in episodes] == SEEDS.tolist()
    for episode in episodes:
        T = 1 + episode.seed % HORIZON
        assert len(episode) == T
        assert (episode.observations[..., 0] == episode.seed).all()
        assert (episode.observations[..., 1] == np.arange(T + 1)[:, None]).all()
        assert (episode.observations[..., 2] == np.arange(N)).all()
        assert (episode.states == [[episode.seed, t] for t in range(T + 1)]).all()
        assert (episode.events[..., 0] == np.arange(1, T + 1)[:, None]).all()
        assert (episode.rewards == episode.actions.sum(2)).all()
        times = np.arange(1, T + 1, dtype=np.float32)[:, None]
        assert (episode.log_probs == -episode.actions[..., 0] * times).all()
        gained = np.diff(episode.observations[:, 0, 3])
        np.testing.assert_allclose(gained, episode.actions.sum((1, 2)), rtol=1e-5)
        ended = episode.terminations | episode.truncations
        assert ended.tolist() == [False] * (T - 1) + [True]
        assert (episode.layout == episode.seed).all()
        assert episode.policy == 5


def test_end_reasons_tell_success_failure_and_horizon() -> None:
    reasons = {e.seed: e.end_reason for e in run(SEEDS, 4)}
    expected = {s: 2 if s % HORIZON == HORIZON - 1 else int(s % 2) for s in SEEDS.tolist()}
    assert reasons == expected
    assert set(reasons.values()) == {0, 1, 2}


@pytest.mark.parametrize("n_copies", [2, 3, 13, 16])
def test_an_episode_is_the_same_in_any_batch_and_order(n_copies: int) -> None:
    alone = {e.seed: e for e in run(SEEDS, 1)}
    for episode in run(SEEDS[::-1].copy(), n_copies):
        assert same(episode, alone[episode.seed])


def test_repeated_seeds_give_repeated_episodes() -> None:
    first, second = run(np.array([4, 4], np.uint64), 2)
    assert same(first, second)
    assert not np.shares_memory(first.states, second.states)


def test_every_wanted_episode_is_reset_once() -> None:
    env, policy = Counting(4), Noisy(4)
    list(rollout(env, policy, SEEDS))
    assert env.n_resets == len(SEEDS)
    assert policy.n_resets.sum() == len(SEEDS)


def test_no_seeds_no_episodes() -> None:
    assert run(np.zeros(0, np.uint64), 3) == []


def test_progress_counts_finished_episodes() -> None:
    calls: list[int] = []
    run(SEEDS, 4, calls.append)
    assert sum(calls) == len(SEEDS)


def test_episodes_stream() -> None:
    env = Counting(1)
    episodes = rollout(env, Noisy(1), SEEDS)
    next(episodes)
    assert env.n_resets == 1


@pytest.mark.parametrize("seeds", [np.array([-1]), np.array([1.5]), np.zeros((2, 2), np.uint64)])
def test_wrong_seeds_are_refused_at_the_call(seeds: Seeds) -> None:
    with pytest.raises(SchemaError, match="expected a list of whole numbers"):
        rollout(Counting(2), Noisy(2), seeds)


def test_wrong_actions_and_log_probs_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    policy, other = Noisy(2), Noisy(2)
    policy.buffer = policy.buffer.astype(np.float64)
    with pytest.raises(SchemaError, match=r"Noisy.act returned float64 .* expected float32"):
        next(rollout(Counting(2), policy, SEEDS))
    monkeypatch.setattr(other, "log_probs", lambda step, actions: actions)
    with pytest.raises(SchemaError, match=r"log_probs returned .* expected float32 \[2, 3\]"):
        next(rollout(Counting(2), other, SEEDS))


def test_an_episode_beyond_the_horizon_is_an_error() -> None:
    with pytest.raises(SchemaError, match="goes on after 7 steps"):
        list(rollout(Counting(2, endless=True), Noisy(2), SEEDS))
