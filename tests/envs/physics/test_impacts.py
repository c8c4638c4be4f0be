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
from swarmdata.types import Counts, Double, Float
from tests.envs.physics.scenes import NOTHING, Scene

RADIUS, SPEED = 0.12, 0.6
HALF = np.array([1.0, 1.0])
TOLERANCE = {"pymunk": DEEPEST_OVERLAP + CREEP, "mujoco": 0.015}
"""m, of overlaps at full speed: MuJoCo stops bodies after they have begun to overlap."""

SIMULATORS = pytest.mark.parametrize("simulator", TOLERANCE)


def drive(
    places: Sequence[Double],
    commands: Sequence[Double],
    simulator: str = "pymunk",
    layout: Float = NOTHING,
    payloads: tuple[Payload, ...] = (),
    n_steps: int = 12,
) -> tuple[Double, Double, Counts]:
    """Robots and payloads, at the origin, after each step of constant commands at full speed.

    Then the events of all steps, [N, 4].
    """
    rows = [[*place, *(SPEED * np.array(v))] for place, v in zip(places, commands, strict=True)]
    scene = Scene([{}] * len(rows), rows, simulator, layout=layout, payloads=payloads, size=2.0)
    return *scene.drive(commands, n_steps), scene.events[0]


@SIMULATORS
@given(angle=st.floats(0.0, 2 * math.pi), gap=st.floats(0.001, 0.2), offset=st.floats(-0.2, 0.2))
@settings(max_examples=30, deadline=None)
def test_two_robots(simulator: str, angle: float, gap: float, offset: float) -> None:
    towards = np.array([math.cos(angle), math.sin(angle)])
    aside = np.array([-towards[1], towards[0]])
    far = math.sqrt((2 * RADIUS + gap) ** 2 - offset**2)
    start = 0.5 * (far * towards + offset * aside)
    teams, _, events = drive([-start, start], [towards, -towards], simulator)
    gaps = [float(np.linalg.norm(t[1, :2] - t[0, :2])) - 2 * RADIUS for t in teams]
    most = 2 * TOLERANCE[simulator] if simulator == "mujoco" else TOLERANCE[simulator] + 0.0005
    assert min(gaps) > -most, "both move: in few episodes a little is added"
    assert not events[:, 3].any()
    if abs(offset) < 0.1:
        assert min(gaps) < 0.01, "they have touched"
        assert events[0, 2] == events[1, 2] >= 1, "a contact counts for both"


@SIMULATORS
@pytest.mark.parametrize("kind", [0, 1, 2, 3])
@given(angle=st.floats(0.0, 2 * math.pi), turn=st.floats(0.0, 2 * math.pi))
@settings(max_examples=20, deadline=None)
def test_an_obstacle(simulator: str, kind: int, angle: float, turn: float) -> None:
    row = [kind, 0, 0, math.cos(turn), math.sin(turn), 0.2, 0.2 if kind != 1 else 0.15, 0.05]
    layout = np.array([row], np.float32)
    towards = np.array([math.cos(angle), math.sin(angle)])
    teams, _, events = drive([-0.6 * towards], [towards], simulator, layout, n_steps=15)
    gaps = [clearance(*t[0, :2], layout, HALF) - RADIUS for t in teams]
    assert -TOLERANCE[simulator] < min(gaps) < {"pymunk": 0.02, "mujoco": 0.005}[simulator]
    assert events[0, 3] >= 1


@SIMULATORS
@given(x=st.floats(-0.8, 0.8), angle=st.floats(-1.2, 1.2))
@settings(max_examples=20, deadline=None)
def test_walls(simulator: str, x: float, angle: float) -> None:
    towards = np.array([math.sin(angle), math.cos(angle)])
    teams, _, events = drive([np.array([x, 0.7])], [towards], simulator)
    gaps = [1.0 - float(np.abs(t[0, :2]).max()) - RADIUS for t in teams]
    assert -TOLERANCE[simulator] < min(gaps) < 0.005
    assert events[0, 3] >= 1


@pytest.mark.parametrize("shape", ["circle", "box"])
@given(angle=st.floats(0.0, 2 * math.pi))
@settings(max_examples=30, deadline=None)
def test_a_payload(shape: str, angle: float) -> None:
    payload = Payload(shape=shape, half_length=0.3, half_width=0.2)  # type: ignore[arg-type]
    towards = np.array([math.cos(angle), math.sin(angle)])
    teams, rows, _ = drive([-0.6 * towards], [towards], payloads=(payload,), n_steps=8)
    gaps = []
    for team, body in zip(teams, rows[:, 0], strict=True):
        size = (0.3, 0.3) if shape == "circle" else (0.3, 0.2)
        row = np.array([shape == "box", body[0], body[1], body[4], body[5], *size, 0.0], np.float64)
        gaps.append(nearest(*team[0, :2], row)[0] - RADIUS)
    assert -TOLERANCE["pymunk"] - 0.001 < min(gaps) < 0.0, "a payload that turns adds a little"


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
