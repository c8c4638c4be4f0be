"""What is timed: our worlds, their physics alone, and the peers, each as a `Run`.

Every engine takes random actions that were drawn before, and computes observations, rewards and
collisions in every step. Ours resets each copy when its episode ends. VMAS resets all copies at
once, which is ten times cheaper than one at a time; MPE2 its only copy.
"""

import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from numba import njit

from swarmdata.envs.physics.backend import Moving, Plan
from swarmdata.envs.physics.dynamics import limits_of
from swarmdata.envs.physics.episode_bodies import payload_rows
from swarmdata.envs.physics.fast_backend import FastBackend
from swarmdata.envs.physics.munk_calls import (
    GET_VELOCITY,
    SET_FORCE,
    STEP,
    call_p_v,
    call_pd,
    call_pv,
    load_addresses,
)
from swarmdata.envs.world.pettingzoo import ParallelWorld
from swarmdata.registry.components import make_env, make_task
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Int

Run = Callable[[float], float]
"""Runs for so many seconds; returns environment steps (joint steps of one copy) per second of the
process's processor time, which other work on the machine disturbs least."""

N_ACTIONS = 64
"""Joint actions drawn in advance, used again and again."""

PEER_HORIZON = 160
"""Steps of an episode of the peers, that of our smallest team: longer than their own."""


def timed(advance: Callable[[int], object], n_copies: int) -> Run:
    """Calls `advance` with the step's number until the time is over."""
    state = {"step": 0}

    def run(seconds: float) -> float:
        first, used = state["step"], time.process_time()
        end = time.perf_counter() + seconds
        while state["step"] == first or time.perf_counter() < end:
            advance(state["step"])
            state["step"] += 1
        return n_copies * (state["step"] - first) / (time.process_time() - used)

    advance(0)  # compiles
    return run


def swarm(spec: TaskSpec, n_copies: int) -> Run:
    env = make_env(spec, n_copies)
    shape = (N_ACTIONS, n_copies, spec.n_agents, env.action_size)
    actions = np.random.default_rng(0).uniform(-1, 1, shape)
    env.reset(np.arange(n_copies, dtype=np.uint64))
    state = {"next": n_copies}

    def advance(k: int) -> None:
        step = env.step(actions[k % N_ACTIONS])
        ended = step.ended
        if np.count_nonzero(ended):
            copies = np.flatnonzero(ended)
            first, state["next"] = state["next"], state["next"] + len(copies)
            env.reset(np.arange(first, state["next"], dtype=np.uint64), copies)

    return timed(advance, n_copies)


def swarm_parallel(spec: TaskSpec) -> Run:
    """One copy of a task, through PettingZoo's dictionaries."""
    env = ParallelWorld(spec)
    shape = env.action_space(env.possible_agents[0]).shape
    return _parallel(env, lambda rng: rng.uniform(-1, 1, shape).astype(np.float32))


def _parallel(env: Any, draw: Callable[[np.random.Generator], Any]) -> Run:
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    actions = [{name: draw(rng) for name in env.possible_agents} for _ in range(N_ACTIONS)]

    def advance(k: int) -> None:
        env.step(actions[k % N_ACTIONS])
        if not env.agents:
            env.reset()

    return timed(advance, 1)


@njit(nogil=True, cache=True)  # type: ignore[untyped-decorator]
def _drive_spaces(
    calls: Int, spaces: Int, bodies: Int, commands: Double, n_substeps: int, dt: float
) -> None:
    """Steps Munk2D's spaces under speed commands, m/s [E, N, 2], and nothing else."""
    forces = np.empty((commands.shape[1], 2))
    for b in range(spaces.shape[0]):
        for i in range(commands.shape[1]):
            vx, vy = call_p_v(calls[GET_VELOCITY], bodies[b, i])
            forces[i, 0] = min(max((commands[b, i, 0] - vx) / (n_substeps * dt), -1.5), 1.5)
            forces[i, 1] = min(max((commands[b, i, 1] - vy) / (n_substeps * dt), -1.5), 1.5)
        for _ in range(n_substeps):
            for i in range(commands.shape[1]):
                call_pv(calls[SET_FORCE], bodies[b, i], forces[i, 0], forces[i, 1])
            call_pd(calls[STEP], spaces[b], dt)


def physics(spec: TaskSpec, n_copies: int) -> Run:
    """The limit: the same worlds, stepped by Munk2D in a compiled loop, and nothing else."""
    calls = load_addresses()
    if calls is None:
        raise RuntimeError("Munk2D's functions cannot be called here; there is no limit to measure")
    task = make_task(spec)
    env = make_env(spec, n_copies)
    step = env.reset(np.arange(n_copies, dtype=np.uint64))
    backend = FastBackend(Plan(spec, task.kinds, task.movables), n_copies, calls)
    robots = step.states[:, : 8 * spec.n_agents].reshape(n_copies, spec.n_agents, 8)
    bodies = step.states[:, 8 * spec.n_agents :][:, : 7 * len(task.movables)]
    moving = Moving(
        robots[..., :6].astype(np.float64), bodies.reshape(n_copies, -1, 7).astype(np.float64),
        limits_of(spec), payload_rows(task.movables),
    )  # fmt: skip
    backend.reset(np.arange(n_copies), step.layouts, moving)
    speed = spec.robots[0].max_speed
    shape = (N_ACTIONS, n_copies, spec.n_agents, 2)
    commands = np.random.default_rng(0).uniform(-speed, speed, shape)

    def advance(k: int) -> None:
        ours = backend.spaces  # the backend owns what the addresses point to
        _drive_spaces(
            calls, ours.spaces, ours.bodies, commands[k % N_ACTIONS], ours.n_substeps, ours.dt
        )

    return timed(advance, n_copies)


def vmas(n_agents: int, n_copies: int, n_rays: int) -> Run:
    """VMAS `navigation` with collisions, in an arena that grows with the team as ours does.

    Without rays, its lidar is switched off, which costs six times the rest.
    """
    import torch

    make_vmas: Any = import_module("vmas").make_env  # a peer to measure, not a dependency

    torch.set_num_threads(1)
    half = (n_agents / 4) ** 0.5
    env = make_vmas(
        "navigation", num_envs=n_copies, device="cpu", continuous_actions=True, seed=0,
        n_agents=n_agents, collisions=True, n_lidar_rays=max(n_rays, 1), lidar_range=0.35,
        world_spawning_x=half, world_spawning_y=half,
    )  # fmt: skip
    if not n_rays:
        nothing = torch.zeros(n_copies, 1)
        for agent in env.agents:
            agent.sensors[0].measure = lambda: nothing
    actions = 2 * torch.rand(N_ACTIONS, n_agents, n_copies, 2) - 1
    table = [list(step.unbind(0)) for step in actions]
    env.reset()

    def advance(k: int) -> None:
        env.step(table[k % N_ACTIONS])
        if k % PEER_HORIZON == PEER_HORIZON - 1:
            env.reset()

    return timed(advance, n_copies)


def mpe2(n_agents: int) -> Run:
    """MPE2 `simple_spread_v3`, through PettingZoo's dictionaries, its only interface."""
    from mpe2 import simple_spread_v3

    env: Any = simple_spread_v3.parallel_env(
        N=n_agents, continuous_actions=True, max_cycles=PEER_HORIZON
    )
    return _parallel(env, lambda rng: rng.random(5, dtype=np.float32))
