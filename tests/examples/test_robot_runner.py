"""The runner of the documentation drives robots as the policy itself would."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import swarmdata
from swarmdata.cli.main import app
from swarmdata.datasets.dataset import Dataset
from tests.support.tiny import make_tiny

pytest.importorskip("torch", reason="algorithms need torch")
pytest.importorskip("onnxruntime", reason="the group 'interop'")
pytest.importorskip("onnxscript", reason="the extra 'onnx'")

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("memory", [[], ["--set", "memory=gru", "--set", "window=4"]])
def test_a_team_of_runners(memory: list[str], tmp_path: Path) -> None:
    from swarmdata.learn.training.run_folder import load_run
    from tests.examples.robot_runner import Runner

    make_tiny(tmp_path / "tiny")
    run, file = tmp_path / "run", tmp_path / "policy.onnx"
    line = ["train", "bc", str(tmp_path / "tiny"), "--seeds", "2", "--updates", "20"]
    line += ["--set", "batch_size=8", *memory, "--out", str(run)]
    assert CliRunner().invoke(app, line).exit_code == 0
    result = CliRunner().invoke(app, ["export-policy", str(run), str(file), "--seed", "1"])
    assert result.exit_code == 0, result.output
    policy = load_run(run)[1]
    env = swarmdata.make_env(Dataset.open(tmp_path / "tiny").task, 1)
    team = [Runner(str(file), name) for name in env.spec.agent_names]
    step = env.reset(np.arange(1, dtype=np.uint64))
    policy.reset(step, np.arange(1))
    for _ in range(8):
        rows = zip(team, step.observations[0].tolist(), strict=True)
        measured = [dict(zip(each.features, row, strict=True)) for each, row in rows]
        actions = np.stack([each.act(seen) for each, seen in zip(team, measured, strict=True)])
        expected = policy.act(step)
        np.testing.assert_allclose(actions, expected[0], atol=1e-5)
        speeds = [each.command(action) for each, action in zip(team, actions, strict=True)]
        np.testing.assert_allclose(speeds, 0.6 * actions, rtol=1e-6)
        step = env.step(actions[None])


def test_the_loop_keeps_the_rate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.examples.robot_runner import Runner

    now = [0.0]
    sent: list[float] = []
    clock = SimpleNamespace(
        monotonic=lambda: now[0], sleep=lambda seconds: now.__setitem__(0, now[0] + seconds)
    )
    monkeypatch.setattr("tests.examples.robot_runner.time", clock)
    runner: Any = object.__new__(Runner)
    runner.time_step = 0.1
    runner.act = runner.command = lambda seen: seen

    def measure() -> float:
        now[0] += 0.03
        return now[0]

    runner.drive(measure, sent.append, seconds=1.0)
    np.testing.assert_allclose(np.diff(sent), 0.1, atol=1e-9)
    assert len(sent) == 10
