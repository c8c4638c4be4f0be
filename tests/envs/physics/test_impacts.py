"""Impacts: whatever robots drive into, and however fast, overlaps stay shallow."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.envs.physics.impacts import CREEP, DEEPEST_OVERLAP, MOST_PARTS, time_to_impact
from swarmdata.numerics.geometry import clearance, nearest
from swarmdata.specs.rules import Payload
from swarmdata.types import Double, Float
from tests.envs.physics.scenes import NOTHING, Scene

RADIUS, SPEED = 0.12, 0.6
HALF = np.array([1.0, 1.0])
TOLERANCE = DEEPEST_OVERLAP + CREEP


def drive(
    places: Sequence[Double],
    commands: Sequence[Double],
    layout: Float = NOTHING,
    payloads: tuple[Payload, ...] = (),
    n_steps: int = 12,
) -> tuple[Double, Double]:
    """Robots and payloads, at the origin, after each step of constant commands at full speed."""
    rows = [[*place, *(SPEED * np.array(v))] for place, v in zip(places, commands, strict=True)]
    scene = Scene([{}] * len(rows), rows, layout=layout, payloads=payloads, size=2.0)
    return scene.drive(commands, n_steps)


@given(angle=st.floats(0.0, 2 * math.pi), gap=st.floats(0.001, 0.2), offset=st.floats(-0.2, 0.2))
@settings(max_examples=60, deadline=None)
def test_two_robots(angle: float, gap: float, offset: float) -> None:
    towards = np.array([math.cos(angle), math.sin(angle)])
    aside = np.array([-towards[1], towards[0]])
    far = math.sqrt((2 * RADIUS + gap) ** 2 - offset**2)
    start = 0.5 * (far * towards + offset * aside)
    teams, _ = drive([-start, start], [towards, -towards])
    gaps = [float(np.linalg.norm(t[1, :2] - t[0, :2])) - 2 * RADIUS for t in teams]
    assert min(gaps) > -TOLERANCE - 0.0005, "both move: in few episodes a little is added"
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
    teams, _ = drive([np.array([x, 0.7])], [towards])
    gaps = [1.0 - float(np.abs(t[0, :2]).max()) - RADIUS for t in teams]
    assert -TOLERANCE < min(gaps) < 1e-6


@pytest.mark.parametrize("shape", ["circle", "box"])
@given(angle=st.floats(0.0, 2 * math.pi))
@settings(max_examples=30, deadline=None)
def test_a_payload(shape: str, angle: float) -> None:
    payload = Payload(shape=shape, half_length=0.3, half_width=0.2)  # type: ignore[arg-type]
    towards = np.array([math.cos(angle), math.sin(angle)])
    teams, rows = drive([-0.6 * towards], [towards], payloads=(payload,), n_steps=8)
    gaps = []
    for team, body in zip(teams, rows[:, 0], strict=True):
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
        NOTHING, np.full(2, 5.0), np.zeros((2, 3)),
    )  # fmt: skip
    assert min(left, dt / MOST_PARTS) <= part <= left
    if part > dt / MOST_PARTS:
        assert speed * part - gap <= DEEPEST_OVERLAP + 1e-12
    if part < left:
        assert speed * left - gap > DEEPEST_OVERLAP
        assert speed * part > gap - DEEPEST_OVERLAP - speed * left / 16
