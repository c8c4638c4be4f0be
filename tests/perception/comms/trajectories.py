"""Runs channels over trajectories."""

from typing import Any, NamedTuple

import numpy as np

from swarmdata import types
from swarmdata.perception.comms.channel import Channel
from swarmdata.specs.state_layout import N_COLUMNS
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Counts, Double, Float, Seeds, Step

GUARD = 3
"""Columns of observations before the received messages: `out` is a strided view, as in use."""


class Log(NamedTuple):
    """What a channel wrote in each step."""

    sent: Float  # [T, E, N, P]
    delivered: Bool  # [T, E, N, N]
    ages: Counts  # [T, E, N, N]
    slots: Float  # [T, E, N, F]


def blank_step(spec: TaskSpec, channel: Channel, n_copies: int) -> Step:
    """A step whose arrays hold what no channel writes, to see what is touched."""
    n = spec.n_agents
    return types.blank_step(
        np.full((n_copies, n, GUARD + len(channel.features)), np.nan, dtype=np.float32),
        np.zeros((n_copies, N_COLUMNS * n + 1), dtype=np.float32),
        sent=np.full((n_copies, n, channel.message_size), np.nan, dtype=np.float32),
        delivered=np.ones((n_copies, n, n), dtype=np.bool_),
        ages=np.full((n_copies, n, n), 123, dtype=np.uint8),
    )


def make_spec(n_agents: int, observation: str = "state", **communication: Any) -> TaskSpec:
    """A team of two kinds of robots in an arena that is not square."""
    fast = {"name": "fast", "count": 1, "robot": {"max_speed": 0.9}}
    slow = {"name": "slow", "count": n_agents - 1, "robot": {"max_speed": 0.4}}
    return TaskSpec.parse(
        {
            "team": [fast, slow] if n_agents > 1 else [fast],
            "arena": {"width": 3.0, "height": 5.0},
            "observation": {"kind": observation},
            "communication": {"kind": "broadcast", **communication},
        }
    )


def make_states(rng: np.random.Generator, n_steps: int, n_copies: int, n_agents: int) -> Float:
    """Robots that jump about, a little outside the arena at times, [T, E, 8 N]."""
    rows = rng.uniform(-2, 2, (n_steps, n_copies, n_agents, N_COLUMNS))
    angles = rng.uniform(0, 7, (n_steps, n_copies, n_agents))
    rows[..., 4], rows[..., 5] = np.cos(angles), np.sin(angles)
    return rows.reshape(n_steps, n_copies, -1).astype(np.float32)


def run(
    spec: TaskSpec,
    states: Float,
    seeds: Seeds,
    actions: Float | Double | None = None,
    channel: Channel | None = None,
) -> Log:
    """Sends whole episodes, all beginning at once, through a new channel or the one given.

    Args:
        spec: the spec.
        states: [T, E, 8 N].
        seeds: [E].
        actions: those that led to each step, [T, E, N, A].
        channel: must have nothing in it.
    """
    n_steps, n_copies, size = states.shape
    channel = channel or Channel(spec, n_copies)
    now = blank_step(spec, channel, n_copies)
    now.seeds[:] = seeds
    active = np.ones(n_copies, dtype=np.bool_)
    rows = []
    for t in range(n_steps):
        now.states[:, :size] = states[t]
        now.times[:] = t
        given = None if actions is None or t == 0 else actions[t]
        channel.transmit(now, now.states, given, active, now.observations[..., GUARD:])
        assert np.isnan(now.observations[..., :GUARD]).all()
        written = (now.sent, now.delivered, now.ages, now.observations[..., GUARD:])
        rows.append([array.copy() for array in written])
    return Log(*(np.array(column) for column in zip(*rows, strict=True)))
