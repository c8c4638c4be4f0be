"""The engine: an episode is one pure function of its seed, on every backend, for every task."""

import pickle
from collections.abc import Callable
from copy import deepcopy
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import swarmdata
from swarmdata.envs.physics.kinematic import KinematicBackend
from swarmdata.envs.physics.public_backend import PublicBackend
from swarmdata.envs.world.task_env import (
    BLOCK_STEPS,
    LASTING_FIELDS,
    WRITTEN_FIELDS,
    StepMaker,
    TaskEnv,
    keep_ended,
)
from swarmdata.errors import MissingExtraError, SchemaError
from swarmdata.registry.components import make_env, make_task
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import TX, UX, UY, VX, VY, Y, robots_of
from swarmdata.specs.task_spec import Robot, TaskSpec
from swarmdata.types import Double, Seeds, Step
from tests.envs.worlds import NO_OBSTACLES, assert_same, seeds_of

UNICYCLES = {"team": [{"count": 4, "robot": {"dynamics": "unicycle"}}]}


def crowd(step: Step, n_agents: int) -> Double:
    """Commands that mix driving at the target and noise from the state's own bits: contacts."""
    robots = robots_of(step.states, n_agents).astype(np.float64)
    wobble = robots[..., : Y + 1] * 1e3 % 1.0 - 0.5
    return 3.0 * (robots[..., TX:] - robots[..., : Y + 1]) + wobble


def play(env: TaskEnv, ids: Seeds, n_steps: int) -> list[Step]:
    steps = [env.reset(ids)]
    for _ in range(n_steps):
        steps.append(env.step(crowd(steps[-1], env.spec.n_agents)))
    return steps


def test_a_partial_reset_leaves_the_other_copies_alone() -> None:
    env = make_env(TaskSpec(), 3)
    env.reset(seeds_of(1, 2, 3))
    for _ in range(30):
        before = env.step(np.full((3, 4, 2), 0.4))
    after = env.reset(seeds_of(9), np.array([1]))
    for name in Step._fields:
        for copy in (0, 2):
            np.testing.assert_array_equal(getattr(before, name)[copy], getattr(after, name)[copy])
    assert (after.seeds[1], after.times[1]) == (9, 0)
    np.testing.assert_array_equal(
        after.states[1], make_env(TaskSpec(), 1).reset(seeds_of(9)).states[0]
    )


def test_an_action_means_the_same_in_either_precision() -> None:
    spec = TaskSpec.parse(UNICYCLES)
    for task in (make_task(TaskSpec()), make_task(spec)):
        single, double = TaskEnv(task, 4), TaskEnv(task, 4)
        ids = np.arange(4, dtype=np.uint64)
        single.reset(ids)
        double.reset(ids)
        rng = np.random.default_rng(0)
        for _ in range(40):
            actions = rng.uniform(-1, 1, (4, 4, 2)).astype(np.float32)
            assert_same([single.step(actions)], [double.step(actions.astype(np.float64))])


@pytest.mark.parametrize(
    "actions", [np.zeros((2, 4, 3)), np.zeros((2, 4, 2), np.int64), np.zeros((2, 4, 2), np.float16)]
)
def test_actions_of_another_shape_or_kind_are_refused(actions: NDArray[np.generic]) -> None:
    env = make_env(TaskSpec(), 2)
    with pytest.raises(SchemaError, match="before the first reset"):
        env.step(actions)  # type: ignore[arg-type]
    env.reset(seeds_of(1, 2))
    with pytest.raises(SchemaError, match=r"expected float32 or float64 \[2, 4, 2\] \[E, N, A\]"):
        env.step(actions)  # type: ignore[arg-type]


@pytest.mark.parametrize("copies", [[2], [-1], [0, 0], [True, False], [0.5], [[0]]])
def test_what_is_no_copy_is_not_reset(copies: list[Any]) -> None:
    env = make_env(TaskSpec(), 2)
    env.reset(seeds_of(1, 2))
    with pytest.raises(SchemaError, match="expected different whole numbers below 2, such as np"):
        env.reset(seeds_of(*range(len(copies))), np.array(copies))


@pytest.mark.parametrize("duplicate", [deepcopy, pickle.dumps])
@pytest.mark.parametrize("options", [{}, {"api": "pettingzoo"}])
def test_environments_are_not_copied(
    options: dict[str, Any], duplicate: Callable[[Any], Any]
) -> None:
    """A copy would move the bodies of the original, and read memory that is gone without it."""
    with pytest.raises(SchemaError, match="cannot be copied or pickled"):
        duplicate(swarmdata.make_env("coop_nav", **options))


def test_a_collision_ends_the_episode_where_the_spec_says_so() -> None:
    env = TaskEnv(make_task(preset("coop_nav").with_updates(on_collision="fail")), 8)
    steps = play(env, np.arange(8, dtype=np.uint64), 160)
    touched = np.array([step.events[..., 2:].any(axis=(1, 2)) for step in steps])
    assert touched.any()
    for step, hit in zip(steps, touched, strict=True):
        np.testing.assert_array_equal(step.terminations[hit], True)
        assert not step.successes[hit].any()


def test_the_spec_chooses_the_simulator(monkeypatch: pytest.MonkeyPatch) -> None:
    env = TaskEnv(make_task(TaskSpec(backend="kinematic")))
    assert isinstance(env._blocks[0]._world._backend, KinematicBackend)
    monkeypatch.setattr("swarmdata.runtime.extras.find_spec", lambda package: None)
    with pytest.raises(MissingExtraError, match=r"backend mujoco needs .* 'swarmdata\[mujoco\]'"):
        TaskEnv(make_task(TaskSpec(backend="mujoco")))


@pytest.mark.parametrize("backend", [KinematicBackend, PublicBackend])
def test_a_unicycle_drives_along_its_heading_only(backend: type[KinematicBackend]) -> None:
    env = TaskEnv(make_task(TaskSpec.parse({**UNICYCLES, "obstacles": NO_OBSTACLES})), 1, backend)
    step = env.reset(seeds_of(4))
    start = robots_of(step.states, 4)[0]
    assert len(np.unique(start[:, UX])) == 4, "headings are drawn"
    command = np.broadcast_to([0.5, 0.6], (1, 4, 2)).astype(np.float32)
    for _ in range(5):
        step = env.step(command)
        now = robots_of(step.states, 4)[0].astype(float)
        aside = now[:, VY] * now[:, UX] - now[:, VX] * now[:, UY]
        ahead = now[:, VX] * now[:, UX] + now[:, VY] * now[:, UY]
        assert np.abs(aside).max() < 0.05 * max(1.0, np.abs(ahead).max())
    turned = np.arctan2(
        start[:, UX] * now[:, UY] - start[:, UY] * now[:, UX],
        start[:, UX] * now[:, UX] + start[:, UY] * now[:, UY],
    )
    np.testing.assert_allclose(turned, 5 * 0.1 * 0.6 * 3.0, rtol=5e-3)
    assert Robot().wheel_grip > 0.6 * 3.0, "wheels that slip in every turn at top speed"


@pytest.mark.parametrize("task", ["coop_nav", "transport"])
def test_compiling_the_physics_first_changes_no_bit(task: str) -> None:
    plain, prepared = make_env(preset(task), 2), make_env(preset(task), 2)
    assert isinstance(plain, TaskEnv)
    assert isinstance(prepared, TaskEnv)

    prepared.compile_physics()

    assert_same(play(plain, seeds_of(3, 4), 20), play(prepared, seeds_of(3, 4), 20))


TALKING = TaskSpec(communication={"kind": "broadcast"})  # type: ignore[arg-type]  # parsed


@pytest.mark.parametrize("n_copies", [1, 3, 64])
@pytest.mark.parametrize("spec", [TaskSpec(), TALKING], ids=["silent", "talking"])
def test_no_two_steps_share_what_is_written(spec: TaskSpec, n_copies: int) -> None:
    first = make_env(spec, n_copies).reset(np.arange(n_copies, dtype=np.uint64))
    maker = StepMaker(first)
    steps = [first, *(maker.after(first) for _ in range(2 * BLOCK_STEPS + 3))]
    names = (*WRITTEN_FIELDS, "sent", "delivered", "ages") if spec is TALKING else WRITTEN_FIELDS
    for name in names:
        arrays = [getattr(step, name) for step in steps]
        assert {(a.shape, a.dtype) for a in arrays} == {(arrays[0].shape, arrays[0].dtype)}
        spans = sorted((a.ctypes.data, a.ctypes.data + a.nbytes) for a in arrays)
        assert all(left[1] <= right[0] for left, right in pairwise(spans))


def test_keep_ended_leaves_active_copies_alone() -> None:
    before = make_env(TaskSpec(), 3).reset(seeds_of(1, 2, 3))
    now = StepMaker(before).after(before)
    for name in LASTING_FIELDS:
        getattr(now, name)[:] = 1
    keep_ended(before, now, np.array([True, False, True]))
    for name in LASTING_FIELDS:
        values = getattr(now, name)
        np.testing.assert_array_equal(values[1], getattr(before, name)[1])
        assert np.all(values[[0, 2]] == 1)
