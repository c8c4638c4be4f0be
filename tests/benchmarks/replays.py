"""Recorded actions of a team, stepped again without the time that its policies need."""

import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from swarmdata.interfaces import Policy
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.recipes import sources
from swarmdata.registry.tiers import TRAINED_TIERS
from swarmdata.rollouts.recipe_episodes import make_source_policy
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float, Int, Seeds, Step

HORIZONS = 2
"""Length of a recording, in horizons of the task."""


class Reset(NamedTuple):
    """New episodes in some copies."""

    seeds: Seeds  # [n]
    copies: Int  # [n]


class Recording(NamedTuple):
    """Joint actions of E copies, and the resets after some of the steps."""

    start: Reset
    actions: Float  # [K, E, N, A]
    resets: Mapping[int, Reset]  # by step


def members(team: str, preset: str, spec: TaskSpec) -> list[Policy]:
    """The policies of a team, which have equal shares; none if a tier has no checkpoints.

    A team is a registered policy, or a tier of the preset, whose checkpoints act without noise.
    """
    if team not in TRAINED_TIERS:
        return [make_policy(team, spec)]
    return [make_source_policy(source, spec) for source in sources(preset, team, noise=0.0)]


def joint_actions(policies: Sequence[Policy], step: Step) -> Float:
    """Actions of all copies, of which each policy has an equal share in turns, [E, N, A]."""
    actions = policies[0].act(step).copy()
    owners = np.arange(len(actions)) % len(policies)
    for index, policy in enumerate(policies[1:], 1):
        actions[owners == index] = policy.act(step)[owners == index]
    return actions


def record(spec: TaskSpec, policies: Sequence[Policy], n_copies: int) -> Recording:
    """Plays the policies; a copy starts a new episode as soon as one has ended."""
    env, resets = make_env(spec, n_copies), {}
    start = Reset(np.arange(n_copies, dtype=np.uint64), np.arange(n_copies))
    played = np.empty(
        (HORIZONS * spec.horizon, n_copies, spec.n_agents, env.action_size), np.float32
    )
    new, n_started = start, n_copies
    step = env.reset(*start)
    for k in range(len(played)):
        if len(new.copies):
            for policy in policies:
                policy.reset(step, new.copies)
        played[k] = joint_actions(policies, step)
        step = env.step(played[k])
        copies = np.flatnonzero(step.ended)
        new = Reset(np.arange(n_started, n_started + len(copies), dtype=np.uint64), copies)
        n_started += len(copies)
        if len(copies):
            resets[k] = new
            step = env.reset(*new)
    return Recording(start, played, resets)


class Replay:
    """A `Run` that steps a recording from its beginning to its end, at least once.

    The task may have other observations than that of the recording, and other messages that the
    robots do not choose, since neither moves a robot. The return to the first step is not timed.
    """

    def __init__(self, spec: TaskSpec, recording: Recording) -> None:
        self._env, self._recording = make_env(spec, len(recording.start.copies)), recording
        self._stepping = self._resetting = 0.0  # s

    def __call__(self, seconds: float) -> float:
        """Steps and resets for at least so many seconds; returns environment steps a second."""
        n_replays, stepping, resetting = 0, 0.0, 0.0
        while stepping + resetting < seconds or not n_replays:
            for_steps, for_resets = self._play()
            stepping, resetting = stepping + for_steps, resetting + for_resets
            n_replays += 1
        self._stepping, self._resetting = self._stepping + stepping, self._resetting + resetting
        n_steps, n_copies = self._recording.actions.shape[:2]
        return n_replays * n_steps * n_copies / (stepping + resetting)

    def _play(self) -> tuple[float, float]:
        """Steps the recording once; returns the seconds that steps and resets take."""
        env, (start, actions, resets), now = self._env, self._recording, time.process_time
        env.reset(*start)
        begin, resetting = now(), 0.0
        for k, joint_action in enumerate(actions):
            env.step(joint_action)
            if k in resets:
                stepped = now()
                env.reset(*resets[k])
                resetting += now() - stepped
        return now() - begin - resetting, resetting

    @property
    def reset_share(self) -> float:
        return self._resetting / (self._stepping + self._resetting)
