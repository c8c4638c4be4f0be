"""Policies are exported by the name of their run, those that learned from logs too."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmdata
from swarmdata.errors import PolicyFitError, SchemaError, SpecError, UnknownNameError
from swarmdata.interop.exported_policies import _commands, export_policy
from swarmdata.registry.presets import preset
from swarmdata.specs.action_scaling import action_scale
from swarmdata.specs.origins import RecordedSpec
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.task_spec import TaskSpec
from tests.examples.robot_runner import Runner
from tests.interop.logs.logged_team import drive, log_map, write_csv
from tests.support.tiny import make_tiny

torch = pytest.importorskip("torch", reason="algorithms need torch")


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> tuple[swarmdata.Dataset, Path, Any]:
    """Two robots, of which one knows its battery too; the run folder, and its policy."""
    folder = tmp_path_factory.mktemp("logged")
    columns = drive(12.0), drive(12.0, 1.0)
    columns[1]["volts"] = np.linspace(12, 11, len(columns[1]["t"]))
    files = [write_csv(folder / f"{name}.csv", each)
             for name, each in zip(("anna", "bert"), columns, strict=True)]  # fmt: skip
    volts = {"name": "battery", "column": "volts"}
    robots = ["anna", {"name": "bert", "features": [volts]}]
    dataset = swarmdata.import_logs(
        files, folder / "data", id="hall-logs-v0",
        log_map=log_map(robots=robots, episodes={"length": 2}),
    )  # fmt: skip
    (policy,) = swarmdata.train(
        "bc", str(dataset.path), folder / "run", n_seeds=1, progress=False,
        changes={"n_updates": "20", "batch_size": "16", "hidden": "8"},
    )  # fmt: skip
    return dataset, folder / "run", policy


@pytest.mark.slow
def test_a_policy_that_learned_from_logs_drives_a_robot(
    logged: tuple[swarmdata.Dataset, Path, Any], tmp_path: Path
) -> None:
    dataset, run, policy = logged
    path = export_policy(run, tmp_path / "policy.py")
    spec, rows = dataset.spec, dataset[0].observations
    assert isinstance(spec, RecordedSpec)
    expected = action_scale(spec).to_environment(policy.actions(rows))
    for number, name in enumerate(("anna", "bert")):
        runner = Runner(str(path), name)
        assert runner.time_step == pytest.approx(0.1)
        for row, command in zip(rows[:, number], expected[:, number], strict=True):
            seen = dict(zip(runner.features, row.tolist(), strict=False))
            found = runner.command(runner.act(seen))
            np.testing.assert_allclose(found, command, rtol=0, atol=1e-6)
    assert Runner(str(path), "anna").features == ["pose.0", "pose.1", "pose.2", "pose.3"]
    assert runner.features == ["battery", "battery_known", *Runner(str(path), "anna").features]
    sent: list[tuple[float, ...]] = []
    runner.drive(lambda: dict.fromkeys(runner.features, 0.0), sent.append, seconds=0.0)
    assert sent == [(0.0, 0.0)]  # v and omega: zero stops it


def test_what_is_no_file_for_robots_is_refused(
    logged: tuple[swarmdata.Dataset, Path, Any], tmp_path: Path
) -> None:
    _, run, _ = logged
    with pytest.raises(SpecError, match=r"suffix '\.npz', expected \.onnx, or \.py"):
        export_policy(run, tmp_path / "policy.npz")
    with pytest.raises(SpecError, match="has the seeds 0, got seed 3"):
        export_policy(run, tmp_path / "policy.py", seed=3)
    assert not list(tmp_path.iterdir())


def test_commands_of_tasks() -> None:
    robots = [
        {"dynamics": "unicycle", "max_speed": 0.5, "max_turn_rate": 2.0},
        {"command": "acceleration", "max_acceleration": 3.0, "mass": 2.0},
        {"dynamics": "unicycle", "drive": "differential"},
    ]
    team = [{"count": 1, "name": f"kind{k}", "robot": robot} for k, robot in enumerate(robots)]
    found = _commands(TaskSpec.parse({"team": team}))
    assert found["time_step"] == 0.1
    assert [each["half"] for each in found["commands"]] == [[0.5, 2.0], [1.5, 1.5], [0.6, 3.0]]
    assert [each["stop"] for each in found["commands"]] == [[0.0, 0.0], None, [0.0, 0.0]]
    assert [each["norm"] for each in found["commands"]] == [None, 2, 1]


def test_choices_are_refused() -> None:
    agent = {
        "name": "a", "observation": {"kind": "box", "shape": [1], "dtype": "float32"},
        "action": {"kind": "discrete", "n": 3},
    }  # fmt: skip
    spec = RecordedSpec.parse(
        {"task": "game", "agents": [agent], "state_size": 1, "state_from": "observations"}
    )
    with pytest.raises(PolicyFitError, match="choose among whole numbers"):
        _commands(spec)


def test_a_policy_of_one_side_drives_its_robots(tmp_path: Path) -> None:
    task = preset("tag").with_updates(horizon=20)
    opponent = PolicySource(label="evader", name="random")
    team = (PolicySource(label="a", name="scripted", opponents=(opponent,)),)
    data = make_tiny(tmp_path / "tag-tiny-v0", id="tag-tiny-v0", spec=task, policies=team)
    few = {"n_updates": "4", "batch_size": "8", "hidden": "8"}
    trained = swarmdata.train(
        "bc", data, tmp_path / "run", side="evader", n_seeds=1, changes=few, progress=False
    )
    policy: Any = trained[0]
    runner = Runner(str(export_policy(tmp_path / "run", tmp_path / "policy.py")), "evader_0")
    step = swarmdata.Dataset.open(data).side("evader")[0]
    robot = task.robots[3]
    for row, expected in zip(
        step.observations[:5, 0], policy.actions(step.observations), strict=False
    ):
        found = runner.command(runner.act(dict(zip(runner.features, row.tolist(), strict=True))))
        np.testing.assert_allclose(found, expected[0] * robot.max_speed, rtol=0, atol=1e-6)


def test_columns_of_logs_are_those_of_exported_policies(
    logged: tuple[swarmdata.Dataset, Path, Any], tmp_path: Path
) -> None:
    dataset, run, _ = logged
    path = export_policy(run, tmp_path / "policy.py")
    for number, name in enumerate(("anna", "bert")):
        columns = dataset.columns("observations", number)
        assert [column.name for column in columns] == Runner(str(path), name).features
    (v, omega) = dataset.columns("actions")
    assert ((v.low, v.high), (omega.low, omega.high)) == ((-0.5, 0.5), (-1, 1))
    with pytest.raises(UnknownNameError, match="array with columns 'states'"):
        dataset.columns("states")
    with pytest.raises(SchemaError, match="agent 2 of 2"):
        dataset.columns("actions", 2)
