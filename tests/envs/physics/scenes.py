"""Robots, obstacles and payloads in one simulator, and what they do under constant commands."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from swarmdata.envs.physics.backend import Contacts, Moving, Plan
from swarmdata.envs.physics.dynamics import limits_of
from swarmdata.envs.physics.episode_bodies import payload_rows
from swarmdata.envs.physics.public_backend import PublicBackend
from swarmdata.envs.world.world import make_backend
from swarmdata.specs.rules import Payload
from swarmdata.specs.task_spec import Arena, Robot, Role, TaskSpec
from swarmdata.types import Double, Float

NOTHING: Float = np.zeros((0, 8), np.float32)

Numbers = Sequence[Sequence[float] | Double]


class Scene:
    """A square arena in one simulator.

    Args:
        robots: fields of each robot.
        rows: x, y, vx, vy of each at the start, and its heading if that is not along x.
        simulator: of the package; `public` is that of Pymunk's own interface.
        layout: the obstacles, [M, 8].
        payloads: at the origin.
        size: of the arena, m.
    """

    def __init__(
        self,
        robots: Sequence[dict[str, Any]],
        rows: Numbers,
        simulator: str = "pymunk",
        *,
        layout: Float = NOTHING,
        payloads: tuple[Payload, ...] = (),
        size: float = 4.0,
    ) -> None:
        if simulator == "mujoco":
            pytest.importorskip("mujoco", reason="mujoco is not installed")
        known: Any = "pymunk" if simulator == "public" else simulator
        team = [Role(name=f"r{k}", count=1, robot=Robot(**each)) for k, each in enumerate(robots)]
        spec = TaskSpec(team=tuple(team), arena=Arena(width=size, height=size), backend=known)
        plan = Plan(spec, layout[:, 0].astype(np.int64), payloads)
        self.backend: Any = (PublicBackend if simulator == "public" else make_backend)(plan, 1)
        self.robots: Double = np.zeros((1, len(robots), 6))
        self.robots[0, :, 4] = 1.0
        self.robots[0, :, : len(rows[0])] = rows
        bodies = np.zeros((1, len(payloads), 7))
        bodies[..., 4] = 1.0
        self._layouts = layout[None]
        self._moving = Moving(self.robots, bodies, limits_of(spec), payload_rows(payloads))
        self.states: Float = np.zeros((1, 8 * len(robots) + 7 * len(payloads)), np.float32)
        self.reset()

    def reset(self) -> None:
        """Puts the robots where `robots` says, and the payloads at the origin."""
        n, n_obstacles = self.robots.shape[1], self._layouts.shape[1]
        self.contacts = Contacts(
            np.zeros((1, n, n), np.bool_),
            np.zeros((1, n, n_obstacles + 4), np.bool_),
            np.zeros((1, n, 3)),
        )
        self.events = np.zeros((1, n, 4), np.uint8)
        self.backend.reset(np.arange(1), self._layouts, self._moving)

    def drive(self, commands: Numbers, n_steps: int) -> tuple[Double, Double]:
        """Robots [n_steps, N, 8] and payloads [n_steps, M, 7] while the robots keep to commands."""
        held, rows = np.array([commands], dtype=np.float64), []
        for _ in range(n_steps):
            self.backend.step(np.ones(1, np.bool_), held, self.contacts, self.events, self.states)
            rows.append(self.states[0].astype(np.float64))
        last = 8 * self.robots.shape[1]
        states = np.array(rows)
        return states[:, :last].reshape(n_steps, -1, 8), states[:, last:].reshape(n_steps, -1, 7)
