"""The lidar against a NumPy twin that meets edges one by one, and what its beams promise."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.interfaces import Task
from swarmdata.perception.sensing.lidar import ray_blocks
from swarmdata.specs.state_layout import robots_of
from swarmdata.types import Double, Float
from tests.perception.sensing import scenes

NOTHING, ROBOT, OBSTACLE, WALL, PAYLOAD = range(5)
GRAZE = 2e-5  # rad; rays that this much decides may differ between float32 and float64


def circle_hit(at: Double, ray: Double, center: Double, radius: float) -> float:
    """Distance at which a ray enters a disc: the smaller root of |at + t ray - center| = radius."""
    to = at - center
    half, rest = float(to @ ray), float(to @ to) - radius * radius
    if rest <= 0:
        return 0.0
    square = half * half - rest
    return -half - np.sqrt(square) if square >= 0 and half < 0 else np.inf


def edge_hit(at: Double, ray: Double, p: Double, q: Double) -> float:
    """Distance at which a ray meets the segment from p to q, by Cramer's rule."""
    edge, to = q - p, p - at
    cross = ray[0] * edge[1] - ray[1] * edge[0]
    if cross == 0:
        return np.inf
    t = (to[0] * edge[1] - to[1] * edge[0]) / cross
    s = (to[0] * ray[1] - to[1] * ray[0]) / cross
    return float(t) if t >= 0 and 0 <= s <= 1 else np.inf


def bar_hit(at: Double, ray: Double, bar: Double) -> float:
    if scenes.encloses(bar, at):
        return 0.0
    return min(edge_hit(at, ray, *pair) for pair in zip(bar, np.roll(bar, -1, 0), strict=True))


def cast(task: Task, state: Float, layout: Float, i: int, angle: float) -> Any:
    """Distance (m) and code of what robot i meets at an angle from its heading."""
    robots = robots_of(state, task.spec.n_agents).astype(np.float64)
    at, heading = robots[i, :2], complex(*robots[i, 4:6]) * np.exp(1j * angle)
    ray = np.array([heading.real, heading.imag])
    w, h = task.spec.arena.width / 2, task.spec.arena.height / 2
    arena = np.array([(-w, -h), (w, -h), (w, h), (-w, h)])
    walls = zip(arena, np.roll(arena, -1, 0), strict=True)
    found = [(min(edge_hit(at, ray, *wall) for wall in walls), WALL)]
    for j, robot in enumerate(task.spec.robots):
        if j != i:
            found.append((circle_hit(at, ray, robots[j, :2], robot.radius), ROBOT))
    for m, row in enumerate(scenes.rows(task, state, layout)):
        code = OBSTACLE if m < len(layout) else PAYLOAD
        if row[0] == 0:
            found.append((circle_hit(at, ray, row[1:3], row[5]), code))
        else:
            found += [(bar_hit(at, ray, bar), code) for bar in scenes.bars(row)]
    model: Any = task.spec.observation
    reach = min(model.range, task.spec.robots[i].sensor_range or np.inf)
    nearest = min(found)
    return nearest if nearest[0] < reach else (model.range, NOTHING)


@pytest.mark.slow
@given(scenes.cases(5, kind="lidar", n_rays=st.integers(1, 37), range=st.floats(0.5, 6.0)))
def test_the_kernel_equals_its_numpy_twin(case: dict[str, Any]) -> None:
    model, n_agents = case["model"], case["n_agents"]
    team = [{"count": n_agents, "robot": case["robot"]}]
    task = scenes.task(model, has_bodies=case["has_bodies"], team=team)
    step = scenes.step(task, 1, case["seed"])
    out, n_rays, span = scenes.observe(task, step), model["n_rays"], model["range"]
    for i, robot_state in enumerate(robots_of(step.states[0], n_agents)):
        np.testing.assert_allclose(out[0, i, :5], scenes.polar(task, robot_state), atol=2e-6)
        beams = out[0, i, 5:].reshape(n_rays, -1)
        for beam, angle in zip(beams, 2 * np.pi * np.arange(n_rays) / n_rays, strict=True):
            near = [
                cast(task, step.states[0], step.layouts[0], i, angle + tilt)
                for tilt in (-GRAZE, 0.0, GRAZE)
            ]
            distances = [distance for distance, _ in near]
            code = 1 + int(beam[1:].argmax()) if beam[1:].any() else NOTHING
            assert code in {code for _, code in near}
            assert min(distances) - 1e-4 <= beam[0] * span <= max(distances) + 1e-4
            assert beam[1:].sum() == (code != NOTHING)
            assert code != NOTHING or beam[0] == 1.0


def test_the_first_ray_points_along_the_heading_and_the_next_to_the_left() -> None:
    task = scenes.task({"kind": "lidar", "n_rays": 4, "range": 4.0}, n_agents=1)
    step = scenes.step(task, 1, 0)
    step.states[0] = [1.0, 0.5, 0, 0, 0, 1, 1, 1]  # heading along world y
    empty = step._replace(layouts=step.layouts[:, :0])
    out = scenes.observe(task, empty)
    distances = out[0, 0, 5:].reshape(4, 4)[:, 0] * 4
    np.testing.assert_allclose(distances, [1.5, 3.0, 2.5, 1.0], atol=1e-6)
    np.testing.assert_allclose(out[0, 0, 3:5], [1, 0], atol=1e-6)  # the target is ahead


@pytest.mark.parametrize("n_rays", [1, 4, 16, 17, 64])
def test_rays_are_unit_vectors_and_spare_lanes_repeat_the_first(n_rays: int) -> None:
    blocks = ray_blocks(n_rays)
    x, y = blocks.transpose(1, 0, 2).reshape(2, -1)
    np.testing.assert_allclose(np.hypot(x, y), 1, atol=1e-7)
    np.testing.assert_allclose(
        np.exp(2j * np.pi * np.arange(n_rays) / n_rays), (x + 1j * y)[:n_rays], atol=1e-6
    )
    assert (x[n_rays:] == 1).all()
    assert (y[n_rays:] == 0).all()


def test_beams_beyond_a_robots_own_range_read_one() -> None:
    """Two robots side by side, one blind beyond 0.3 m: only the other sees."""
    far = {"name": "far", "count": 1}
    near = {"name": "near", "count": 1, "robot": {"sensor_range": 0.3}}
    task = scenes.task({"kind": "lidar", "n_rays": 4, "range": 1.0}, team=[far, near])
    step = scenes.step(task, 1, 0)
    step.states[0] = [0, 0, 0, 0, 1, 0, 0, 0, 0.5, 0, 0, 0, 1, 0, 0, 0]
    out = scenes.observe(task, step._replace(layouts=step.layouts[:, :0]))
    beams = out[0, :, 5:21].reshape(2, 4, 4)
    np.testing.assert_allclose(beams[0, 0], [0.38, 1, 0, 0], atol=1e-6)
    np.testing.assert_array_equal(beams[1, 2], [1, 0, 0, 0])


SCRIPT = """
import hashlib, numpy as np
from swarmdata.perception.sensing.lidar import ray_blocks, scan
from swarmdata.perception.sensing.sensed_scene import SCENE, Scene
from swarmdata.runtime.argument_blocks import ArgumentBlock

rng = np.random.default_rng(0)
states = rng.uniform(-1.9, 1.9, (300, 32)).astype(np.float32)
states.reshape(300, 4, 8)[..., 4:6] = 0.6, 0.8
layouts = rng.uniform(0.05, 0.4, (300, 6, 8)).astype(np.float32)
layouts[..., 0], layouts[..., 3:5] = (0, 0, 1, 2, 3, 3), (0.28, 0.96)
layouts[..., 1:3] = rng.uniform(-1.9, 1.9, (300, 6, 2))
out = np.zeros((300, 4, 5 + 4 * 33), dtype=np.float32)
sizes = np.full(4, 0.12), np.full(4, np.inf), np.full(2, 2.0)
scene = Scene(4, *sizes, 5.5, np.zeros((0, 3)), False, 33, 2.0, ray_blocks(33))
block = ArgumentBlock(scene, SCENE)
scan(block.packed, states, layouts, states, 0, 4, np.ones(300, dtype=bool), out)
print(hashlib.sha256(out.tobytes()).hexdigest())
"""


@pytest.mark.slow
@pytest.mark.parametrize("target", [{"NUMBA_CPU_NAME": "generic"}, {"NUMBA_OPT": "0"}])
def test_the_bits_do_not_depend_on_the_processors_registers(
    target: dict[str, str], tmp_path: Path
) -> None:
    """Wide registers, narrow ones, and none: the same scan."""
    digests = set()
    for name, changes in (("native", {}), ("other", target)):
        cache = {"NUMBA_CACHE_DIR": str(tmp_path / name)}
        command = [sys.executable, "-W", "ignore", "-c", SCRIPT]
        run = subprocess.run(
            command,
            env={**os.environ, **cache, **changes},
            capture_output=True,
            text=True,
            check=True,
        )
        digests.add(run.stdout)
    assert len(digests) == 1
