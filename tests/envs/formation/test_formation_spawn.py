"""What every episode of `formation` promises, over many seeds and specs."""

from typing import Any

import numpy as np
import pytest

from swarmdata.envs.formation.formation import Formation
from swarmdata.envs.formation.formation_rules import PATH_CHECK_STEPS, FormationRules
from swarmdata.envs.formation.formation_spawn import MAX_SLOT_SPEED_SHARE
from swarmdata.envs.formation.reference_path import write_motion
from swarmdata.envs.formation.shapes import slot_offsets
from swarmdata.errors import SpawnError, SpecError
from swarmdata.numerics.geometry import clearance
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import state_size
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Seeds
from tests.envs.worlds import NO_OBSTACLES, rules_of
from tests.support.pairs import every

NAMES = ("formation", "formation-n3", "formation-n8", "formation-n16", "formation-easy",
         "formation-hard", "formation-line", "formation-unicycle")  # fmt: skip


def spawned(spec: TaskSpec, seeds: Seeds) -> tuple[Formation, Float, Float]:
    task = Formation(spec)
    layouts = np.full((len(seeds), len(task.kinds), 8), np.nan, dtype=np.float32)
    size = state_size(spec.n_agents, 0, len(task.extras))
    states = np.full((len(seeds), size), np.nan, dtype=np.float32)
    task.spawn(seeds, np.arange(len(seeds)), layouts, states)
    return task, layouts, states


def motions_of(task: Formation, state: Float, steps: Double) -> Double:
    """The reference at these control steps, [L, 7]."""
    points = np.ascontiguousarray(
        state[
            task.spec.n_agents * 8 + [column.name for column in task.extras].index("control_0_x") :
        ]
    )
    out = np.zeros((len(steps), 7))
    for row, step in zip(out, steps, strict=True):
        s = float(step) * task.spec.control_dt * task.segment_rate
        write_motion(points, 0, s, task.segment_rate, row, 0)
    return out


def slots_at(motion: Double, offsets: Double) -> Double:
    turn = np.array([[motion[4], -motion[5]], [motion[5], motion[4]]])
    return np.asarray(motion[:2] + offsets @ turn.T)


@pytest.mark.parametrize("name", every(3, NAMES))
def test_every_episode_keeps_its_promises(name: str) -> None:
    spec = preset(name)
    rules = spec.rules
    assert isinstance(rules, FormationRules)
    task, layouts, states = spawned(spec, np.arange(40, dtype=np.uint64))
    assert np.isfinite(states).all()
    assert np.isfinite(layouts).all()
    half = np.array([spec.arena.width, spec.arena.height]) / 2
    radii = np.array([robot.radius for robot in spec.robots])
    offsets = slot_offsets(rules, spec.n_agents)
    top = MAX_SLOT_SPEED_SHARE * min(robot.max_speed for robot in spec.robots)
    for layout, state in zip(layouts, states, strict=True):
        motions = motions_of(
            task, state, np.arange(0, spec.horizon + 1, PATH_CHECK_STEPS, dtype=np.float64)
        )
        n_blocked = 0
        for motion in motions:
            slots = slots_at(motion, offsets)
            assert (np.abs(slots) <= half - radii.max()).all(), "a slot is in a wall"
            free = [clearance(x, y, layout, half) for x, y in slots]
            n_blocked += min(free) < radii.max()
            path_free = clearance(motion[0], motion[1], layout, half + 10.0)
            assert path_free >= rules.path_clearance - 1e-5, "an obstacle is on the path"
            arms = slots - motion[:2]
            drift = motion[2:4] + motion[6] * np.stack([-arms[:, 1], arms[:, 0]], axis=1)
            assert np.linalg.norm(drift, axis=1).max() <= 1.05 * top
        low, high = rules.blocked
        assert low - 1e-9 <= n_blocked / len(motions) <= high + 1e-9


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ({"reference_speed": 0.5}, r"reference_speed is 0.5 m/s, expected at most 0.48"),
        ({"blocked": (0.3, 0.1)}, r"blocked is \(0.3, 0.1\).*the smaller share first"),
        ({"blocked": (0.1, 0.5)}, r"hold_fraction is 0.6, expected .* no more than what is left"),
        ({"spacing": 4.0}, r"a wedge of 4 robots reaches .* does not fit in the arena of 5 x 5 m"),
        ({"spacing": 0.2}, r"rules.spacing is 0.2 m, expected at least 0.29 m"),
    ],
)
def test_contradictions_are_refused(rules: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        Formation(rules_of(preset("formation"), **rules))


def test_a_team_that_nothing_can_block_is_refused() -> None:
    with pytest.raises(SpecError, match=r"blocked begins at 0.1, expected 0: .* reach 0.12 m"):
        Formation(preset("formation").with_updates(team=[{"count": 1}]))


def test_what_cannot_be_drawn_says_so() -> None:
    spec = rules_of(preset("formation"), blocked=(0.39, 0.4)).with_updates(
        obstacles=NO_OBSTACLES, spawn={"max_attempts": 20}
    )
    with pytest.raises(SpawnError, match=r"seed 3 in 20 attempts: .* block a slot 39% to 40%"):
        spawned(spec, np.array([3], dtype=np.uint64))
