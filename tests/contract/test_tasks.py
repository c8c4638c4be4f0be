"""Every registered task keeps the contract, under every model, drive and team."""

from typing import Any

import pytest

from swarmdata.registry.components import TASKS, make_env
from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.observation_names import observation_model
from swarmdata.specs.task_spec import Role, TaskSpec
from swarmdata.testing.task_contract import check_task

OBSERVATIONS = (
    "state",
    "lidar",
    "bearing",
    "occupancy",
    "bearing+noise-0.05+dropout-0.1+delay-2+stack-3",
)
CHANNELS = (
    "none",
    "perfect",
    "lossy-30+delayed-2+range-1.5",
    "bursty-30+bits-6+learned-3",
    "ring+aloha-4",
)
ROBOTS: dict[str, dict[str, Any]] = {
    "holonomic": {},
    "unicycle": {"dynamics": "unicycle"},
    "acceleration": {"command": "acceleration"},
    "unicycle-acceleration": {"dynamics": "unicycle", "command": "acceleration"},
}

LATE = {"command_delay": 2, "actuator_lag": 0.2}


def with_robot(spec: TaskSpec, changes: dict[str, Any]) -> TaskSpec:
    team = [
        Role(name=role.name, count=role.count, robot=role.robot.model_copy(update=changes))
        for role in spec.team
    ]
    return spec.with_updates(team=team)


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("robot", [*ROBOTS, "late"])
@pytest.mark.parametrize("backend", ["mujoco", "kinematic", "pymunk"])
def test_every_simulator_keeps_the_contract(task: str, robot: str, backend: str) -> None:
    if backend == "mujoco":
        pytest.importorskip("mujoco", reason="mujoco is not installed")
    spec = preset(task).with_updates(
        observation=observation_model("lidar"),
        communication=communication_model("lossy-30"),
        backend=backend,
    )
    check_task(make_env, with_robot(spec, {**ROBOTS, "late": LATE}[robot]), n_steps=12)


@pytest.mark.slow
@pytest.mark.parametrize("name", preset_names())
def test_every_preset_keeps_the_contract_in_mujoco(name: str) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    check_task(make_env, preset(name).with_updates(backend="mujoco"), n_steps=30)


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_keeps_the_contract(name: str) -> None:
    check_task(make_env, preset(name), n_steps=30)


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("horizon", [1, 20])
def test_the_horizon_truncates(task: str, horizon: int) -> None:
    check_task(make_env, preset(task).with_updates(horizon=horizon), n_steps=25)


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("observation", OBSERVATIONS)
@pytest.mark.parametrize("channel", CHANNELS)
def test_models_and_drives_keep_the_contract(
    task: str, robot: str, observation: str, channel: str
) -> None:
    spec = preset(task).with_updates(
        observation=observation_model(observation), communication=communication_model(channel)
    )
    check_task(make_env, with_robot(spec, ROBOTS[robot]), n_steps=12)
