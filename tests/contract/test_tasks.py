"""Every registered task keeps the contract, under every model, drive and team."""

from typing import Any

import pytest

from swarmdata.registry.components import TASKS, make_env
from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.observation_names import observation_model
from swarmdata.specs.task_spec import Role, TaskSpec
from swarmdata.testing.task_contract import check_task
from tests.support.pairs import once_each, pairwise

OBSERVATIONS = (
    "state",
    "lidar",
    "bearing",
    "occupancy",
    "bearing+noise-0.05+dropout-0.1+delay-2+stack-3",
    "state+body-frame+drift-0.05+landmarks-0.6",
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
    "late": {"command_delay": 2, "actuator_lag": 0.2},
    "heavy": {"mass": 3.0},
    "slippery": {"dynamics": "unicycle", "wheel_grip": 1.0},
    "differential": {"dynamics": "unicycle", "drive": "differential"},
}
BACKENDS = ("mujoco", "kinematic", "pymunk")
RANGES: dict[str, tuple[float, float]] = {
    "max_speed": (0.3, 0.9),
    "max_acceleration": (0.8, 2.0),
    "mass": (0.5, 3.0),
    "command_delay": (0, 4),
    "actuator_lag": (0.0, 0.4),
    "noise": (0.0, 0.1),
    "drop_probability": (0.1, 0.8),
}
WHEELS = {"dynamics": "unicycle", "base": "wheels"}


PAIRS = [
    case.values
    for case in pairwise(tuple(TASKS), tuple(ROBOTS), OBSERVATIONS, CHANNELS, BACKENDS)
    if not case.marks  # the others are thousands
]


def with_robot(spec: TaskSpec, changes: dict[str, Any]) -> TaskSpec:
    team = [
        Role(name=role.name, count=role.count, robot=role.robot.model_copy(update=changes))
        for role in spec.team
    ]
    return spec.with_updates(team=team)


def check(spec: TaskSpec, n_steps: int) -> None:
    if spec.backend == "mujoco":
        pytest.importorskip("mujoco", reason="mujoco is not installed")
    check_task(make_env, spec, n_steps=n_steps)


@pytest.mark.parametrize(
    ("task", "robot", "observation", "channel", "backend"),
    [
        pytest.param(*case, marks=[] if k % 3 == 0 else [pytest.mark.slow])
        for k, case in enumerate(PAIRS)
    ],
)
def test_models_drives_and_simulators_keep_the_contract(
    task: str, robot: str, observation: str, channel: str, backend: str
) -> None:
    spec = preset(task).with_updates(
        observation=observation_model(observation),
        communication=communication_model(channel),
        backend=backend,
    )
    check(with_robot(spec, ROBOTS[robot]), 12)


@pytest.mark.parametrize(("task", "backend"), once_each(tuple(TASKS), BACKENDS))
def test_drawn_bodies_keep_the_contract(task: str, backend: str) -> None:
    rough = {} if backend == "kinematic" else {"friction": (0.0, 1.0)}
    spec = preset(task).with_updates(
        observation=observation_model("lidar"),
        communication=communication_model("lossy-30"),
        backend=backend,
        randomization={**RANGES, **rough},
    )
    check(spec, 20)


@pytest.mark.parametrize(("task", "command"), once_each(tuple(TASKS), ("velocity", "acceleration")))
def test_robots_on_wheels_keep_the_contract(task: str, command: str) -> None:
    spec = preset(task).with_updates(backend="mujoco")
    check(with_robot(spec, {**WHEELS, "command": command}), 30)


@pytest.mark.slow
@pytest.mark.parametrize("name", preset_names())
def test_every_preset_keeps_the_contract_in_mujoco(name: str) -> None:
    check(preset(name).with_updates(backend="mujoco"), 30)


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_keeps_the_contract(name: str) -> None:
    check(preset(name), 12)


@pytest.mark.parametrize(("task", "horizon"), once_each(tuple(TASKS), (1, 20)))
def test_the_horizon_truncates(task: str, horizon: int) -> None:
    check_task(make_env, preset(task).with_updates(horizon=horizon), n_steps=25)


def test_a_robot_that_was_pushed_brakes_once_it_is_free() -> None:
    spec = {"team": [{"count": 3}], "arena": {"width": 3.4, "height": 3.4}, "horizon": 120}
    nothing = dict.fromkeys(("circles", "boxes", "corners", "pockets"), 0)
    check_task(make_env, TaskSpec.parse({**spec, "obstacles": nothing}))
