"""The scripted controller of `formation`: where it aims, and that it gets there."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.behavior_policies.formation_controller import (
    FREE_SLOT_GAP,
    FormationController,
    SlotPaths,
    aim_at_slots,
    next_free_position,
)
from swarmdata.envs.formation.formation import Formation
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import CIRCLE, clearance
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Step

HALF = np.array([2.5, 2.5])


def aims(step: Step, task: Formation) -> tuple[Double, Double]:
    targets, drifts = np.zeros((2, len(step.states), task.spec.n_agents, 2))
    paths = SlotPaths.of(task)
    aim_at_slots(step.states, step.times, step.layouts, paths, targets, drifts)
    return targets, drifts


def a_step(spec: TaskSpec, seed: int, n_steps: int) -> tuple[Formation, Step]:
    env = make_env(spec, 2)
    step = env.reset(np.array([seed, seed + 1], dtype=np.uint64))
    for _ in range(n_steps):
        step = env.step(np.zeros((2, spec.n_agents, 2), dtype=np.float32))
    task = env.task
    assert isinstance(task, Formation)
    return task, step


@given(seed=st.integers(0, 10_000), n_steps=st.integers(0, 60))
def test_free_slots_are_followed_and_blocked_ones_awaited(seed: int, n_steps: int) -> None:
    task, step = a_step(preset("formation"), seed, n_steps)
    targets, drifts = aims(step, task)
    slots = robots_of(step.states, 4)[..., [TX, TY]].astype(np.float64)
    for b in range(2):
        for i in range(4):
            is_free = clearance(*slots[b, i], step.layouts[b], HALF) >= 0.12 + FREE_SLOT_GAP
            if is_free:
                np.testing.assert_array_equal(targets[b, i], slots[b, i])
                assert np.linalg.norm(drifts[b, i]) > 0.0
            elif (targets[b, i] != slots[b, i]).any():
                assert clearance(*targets[b, i], step.layouts[b], HALF) >= 0.12 + FREE_SLOT_GAP
                np.testing.assert_array_equal(drifts[b, i], 0.0)


def test_a_blocked_slot_is_awaited_where_it_comes_out() -> None:
    task, step = a_step(preset("formation"), 3, 0)
    states, layouts = step.states.copy(), step.layouts.copy()
    layouts[:, :, 1:3] = 30.0  # out of the way, but for one circle around robot 0's slot
    slot = states[0, [TX, TY]].astype(np.float64)
    layouts[0, 0] = (CIRCLE, *slot, 1.0, 0.0, 0.2, 0.2, 0.0)
    targets, drifts = aims(step._replace(states=states, layouts=layouts), task)
    away = np.linalg.norm(targets[0, 0] - slot)
    assert 0.2 + 0.12 + FREE_SLOT_GAP - 1e-6 <= away <= 0.5
    np.testing.assert_array_equal(drifts[0, 0], 0.0)
    ahead = states[0, N_COLUMNS * 4 + 2 : N_COLUMNS * 4 + 4] @ (targets[0, 0] - slot)
    assert ahead > 0.0, "it waits where the slot comes from"


def test_a_slot_that_stays_blocked_has_no_free_position() -> None:
    task, step = a_step(preset("formation"), 3, 0)
    layout = np.array([[CIRCLE, 0, 0, 1, 0, 9, 9, 0]], dtype=np.float32)
    slot, paths = (0.0, 0.0), SlotPaths.of(task)
    found = next_free_position(step.states[0], slot, 0.0, paths, 0.14, layout)
    assert not found[0]


def test_another_tasks_spec_is_refused() -> None:
    with pytest.raises(SpecError, match="expected 'formation'"):
        FormationController(preset("coop_nav"))
