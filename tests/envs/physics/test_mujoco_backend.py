"""MuJoCo as a simulator: commands as in Pymunk, repeatable, and models that are the compiled."""

from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed")

from swarmdata.envs.physics.mujoco_backend import MujocoBackend
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.errors import SimulationError
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.specs.task_spec import TaskSpec
from tests.envs.physics.scenes import Scene
from tests.envs.worlds import NO_OBSTACLES


def test_free_robots_drive_as_in_pymunk() -> None:
    """Only the order of integration differs: positions by less than a step's change of speed."""
    spec = TaskSpec.parse({"obstacles": NO_OBSTACLES})
    steps = {}
    for backend in ("pymunk", "mujoco"):
        env = make_env(spec.with_updates(backend=backend))
        env.reset(np.array([3], np.uint64))
        actions = np.zeros((1, 4, 2))
        actions[0, 0] = 0.6, -0.4
        steps[backend] = [env.step(actions) for _ in range(5)]
    assert not steps["pymunk"][-1].events.any()
    for ours, theirs in zip(steps["mujoco"], steps["pymunk"], strict=True):
        robots, others = ours.states[0, :32], theirs.states[0, :32]
        np.testing.assert_allclose(
            robots.reshape(4, 8)[:, 2:4], others.reshape(4, 8)[:, 2:4], atol=1e-6
        )
        np.testing.assert_allclose(robots, others, atol=1.5 * 0.05**2 * 2 * 5)


def test_threads_and_batches_give_the_same_bits() -> None:
    spec = preset("coop_nav").with_updates(backend="mujoco")
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 4, 4, 2))
    ids = np.arange(4, dtype=np.uint64)
    one, two, alone = make_env(spec, 4), make_env(spec, 4, n_threads=2), make_env(spec)
    for env in (one, two):
        env.reset(ids)
    alone.reset(ids[2:3])
    for t in range(40):
        steps = [env.step(actions[t // 8]) for env in (one, two)]
        assert all(map(np.array_equal, *steps))
        single = alone.step(actions[t // 8, 2:3])
        np.testing.assert_array_equal(single.states[0], steps[0].states[2])
    two.close()


def test_a_warning_of_mujoco_is_an_error() -> None:
    import mujoco

    scene = Scene([{}] * 2, [[0.0, 0.0, 0, 0], [0.5, 0.0, 0, 0]], "mujoco", size=2.0)
    data = scene.backend._copy(0).data
    scene.drive([[1, 0], [-1, 0]], 1)
    data.warning[mujoco.mjtWarning.mjWARN_CONTACTFULL].number = 2
    with pytest.raises(SimulationError, match="mjWARN_CONTACTFULL"):
        scene.drive([[1, 0], [-1, 0]], 1)


DERIVED_TREES = {"bvh_aabb", "bvh_nodeid"}
"""What the compiler derives and `WorldModel` does not write: trees that are switched off."""


def numbers_of(model: Any) -> dict[str, Any]:
    """All arrays and statistics of a model, by name."""
    found = {name: getattr(model, name) for name in dir(model) if not name.startswith("_")}
    arrays = {name: value.copy() for name, value in found.items() if isinstance(value, np.ndarray)}
    return arrays | {"meaninertia": model.stat.meaninertia}


@pytest.mark.parametrize(
    ("name", "ranges"),
    [
        ("coop_nav", {}),
        ("coop_nav", {"mass": (0.5, 2.0), "friction": (0.0, 1.0)}),
        ("transport", {"payload_mass": (1.0, 9.0), "payload_friction": (0.5, 6.0)}),
        ("coop_nav-wheeled", {"mass": (0.5, 2.0), "wheel_grip": (1.0, 6.0)}),
    ],
)
def test_a_written_model_is_the_compiled_one(name: str, ranges: dict[str, Any]) -> None:
    """MuJoCo's compiler, given the numbers that were written, derives the same ones."""
    spec = preset(name).with_updates(backend="mujoco", randomization=ranges)
    env = make_env(spec, 2)
    assert isinstance(env, TaskEnv)
    for seed in (1, 3):  # new worlds, and used ones
        env.reset(np.array([seed, seed + 1], np.uint64))
    backend = env._blocks[0]._world._backend
    assert isinstance(backend, MujocoBackend)
    for b in range(2):
        written, source = numbers_of(backend._copy(b).model), backend._model.source.copy()
        for geom in source.geoms:
            geom.pos, geom.quat, geom.size, geom.friction = (
                written[f"geom_{field}"][geom.id] for field in ("pos", "quat", "size", "friction")
            )
        for body in source.bodies[1:]:
            body.mass, body.inertia = (
                written["body_mass"][body.id],
                written["body_inertia"][body.id],
            )
        for joint in source.joints:
            joint.armature = written["dof_armature"][written["jnt_dofadr"][joint.id]]
        for actuator in source.actuators:
            actuator.forcerange = written["actuator_forcerange"][actuator.id]
        for pair, slide in zip(source.pairs, written["pair_friction"], strict=True):
            pair.friction = slide
        compiled = numbers_of(source.compile())
        for field, values in compiled.items():
            if field not in DERIVED_TREES:
                np.testing.assert_array_equal(written[field], values, err_msg=field)
