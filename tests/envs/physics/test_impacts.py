"""Impacts: whatever robots drive into, and however fast, overlaps stay shallow."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.envs.physics.backend import Contacts, Plan
from swarmdata.envs.physics.dynamics import limits_of
from swarmdata.envs.physics.episode_bodies import payload_rows
from swarmdata.envs.physics.impacts import CREEP, DEEPEST_OVERLAP, MOST_PARTS, time_to_impact
from swarmdata.envs.world.world import make_backend
from swarmdata.numerics.geometry import clearance, nearest
from swarmdata.specs.rules import Payload
from swarmdata.specs.task_spec import Arena, Role, TaskSpec
from swarmdata.types import Double, Float

RADIUS, SPEED = 0.12, 0.6
HALF = np.array([1.0, 1.0])
TOLERANCE = DEEPEST_OVERLAP + CREEP


def drive(
    places: Sequence[Sequence[float] | Double],
    commands: Sequence[Sequence[float] | Double],
    layout: Float,
    payload: Payload | None = None,
    n_steps: int = 12,
) -> tuple[list[Double], list[Double]]:
    """Robots and payloads, at the origin, after each step of constant commands at full speed."""
    n, movables = len(places), () if payload is None else (payload,)
    spec = TaskSpec(team=(Role(count=n),), arena=Arena(width=2.0, height=2.0))
    kinds = layout[:, 0].astype(np.int64)
    backend = make_backend(Plan(spec, kinds, movables), 1)
    robots, bodies = np.zeros((1, n, 6)), np.zeros((1, len(movables), 7))
    robots[0, :, :2], robots[0, :, 2:4] = places, SPEED * np.array(commands)
    robots[0, :, 4], bodies[..., 4] = 1.0, 1.0
    backend.reset(
        np.arange(1), layout[None], robots, bodies, limits_of(spec)[None], payload_rows(movables)
    )
    contacts = Contacts(
        np.zeros((1, n, n), np.bool_),
        np.zeros((1, n, len(kinds) + 4), np.bool_),
        np.zeros((1, n, 3)),
    )
    states = np.zeros((1, 8 * n + 7 * len(movables)), np.float32)
    teams, rows = [], []
    for _ in range(n_steps):
        events = np.zeros((1, n, 4), np.uint8)
        held = np.array([commands], dtype=np.float64)
        backend.step(np.ones(1, np.bool_), held, contacts, events, states)
        teams.append(states[0, : 8 * n].reshape(n, 8).astype(np.float64))
        rows.append(states[0, 8 * n :].astype(np.float64))
    return teams, rows


@given(angle=st.floats(0.0, 2 * math.pi), gap=st.floats(0.001, 0.2), offset=st.floats(-0.2, 0.2))
@settings(max_examples=60, deadline=None)
def test_two_robots(angle: float, gap: float, offset: float) -> None:
    towards = np.array([math.cos(angle), math.sin(angle)])
    aside = np.array([-towards[1], towards[0]])
    far = math.sqrt((2 * RADIUS + gap) ** 2 - offset**2)
    start = 0.5 * (far * towards + offset * aside)
    nothing = np.zeros((0, 8), np.float32)
    teams, _ = drive([-start, start], [towards, -towards], nothing)
    gaps = [float(np.linalg.norm(t[1, :2] - t[0, :2])) - 2 * RADIUS for t in teams]
    assert min(gaps) > -TOLERANCE
    if abs(offset) < 0.1:
        assert min(gaps) < 0.0, "they have touched"


@pytest.mark.parametrize("kind", [0, 1, 2, 3])
@given(angle=st.floats(0.0, 2 * math.pi), turn=st.floats(0.0, 2 * math.pi))
@settings(max_examples=40, deadline=None)
def test_an_obstacle(kind: int, angle: float, turn: float) -> None:
    row = [kind, 0, 0, math.cos(turn), math.sin(turn), 0.2, 0.2 if kind != 1 else 0.15, 0.05]
    layout = np.array([row], np.float32)
    towards = np.array([math.cos(angle), math.sin(angle)])
    teams, _ = drive([-0.6 * towards], [towards], layout, n_steps=15)
    gaps = [clearance(*t[0, :2], layout, HALF) - RADIUS for t in teams]
    assert -TOLERANCE < min(gaps) < 0.02


@given(x=st.floats(-0.8, 0.8), angle=st.floats(-1.2, 1.2))
@settings(max_examples=40, deadline=None)
def test_walls(x: float, angle: float) -> None:
    towards = np.array([math.sin(angle), math.cos(angle)])
    teams, _ = drive([[x, 0.7]], [towards], np.zeros((0, 8), np.float32))
    gaps = [1.0 - float(np.abs(t[0, :2]).max()) - RADIUS for t in teams]
    assert -TOLERANCE < min(gaps) < 1e-6


@pytest.mark.parametrize("shape", ["circle", "box"])
@given(angle=st.floats(0.0, 2 * math.pi))
@settings(max_examples=30, deadline=None)
def test_a_payload(shape: str, angle: float) -> None:
    payload = Payload(shape=shape, half_length=0.3, half_width=0.2)  # type: ignore[arg-type]
    towards = np.array([math.cos(angle), math.sin(angle)])
    nothing = np.zeros((0, 8), np.float32)
    teams, rows = drive([-0.6 * towards], [towards], nothing, payload, n_steps=8)
    gaps = []
    for team, body in zip(teams, rows, strict=True):
        size = (0.3, 0.3) if shape == "circle" else (0.3, 0.2)
        row = np.array([shape == "box", body[0], body[1], body[4], body[5], *size, 0.0], np.float64)
        gaps.append(nearest(*team[0, :2], row)[0] - RADIUS)
    assert -TOLERANCE - 0.001 < min(gaps) < 0.0, "a payload that turns adds a little"


@given(gap=st.floats(0.0, 0.1), speed=st.floats(0.0, 3.0), left=st.floats(0.003, 0.05))
def test_parts_end_at_the_touch(gap: float, speed: float, left: float) -> None:
    """Between `dt / MOST_PARTS` and what is left; overlaps are shallow unless that is too long."""
    dt = 0.05
    robots = np.zeros((2, 6))
    robots[1, 0], robots[0, 2] = 2 * RADIUS + gap, speed
    part = time_to_impact(
        robots, np.zeros((0, 7)), left, dt, np.full(2, RADIUS), np.zeros((0, 3)),
        np.zeros((0, 8), np.float32), np.full(2, 5.0), np.zeros((2, 3)),
    )  # fmt: skip
    assert min(left, dt / MOST_PARTS) <= part <= left
    if part > dt / MOST_PARTS:
        assert speed * part - gap <= DEEPEST_OVERLAP + 1e-12
    if part < left:
        assert speed * left - gap > DEEPEST_OVERLAP
        assert speed * part > gap - DEEPEST_OVERLAP - speed * left / 16
