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

pytest.importorskip("onnxruntime", reason="the group 'interop'")


@pytest.mark.slow
@pytest.mark.parametrize("memory", [[], ["--set", "memory=gru", "--set", "window=4"]])
def test_a_team_of_runners(memory: list[str], tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="algorithms need torch")
    pytest.importorskip("onnxscript", reason="the extra 'onnx'")
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


FEATURES = ["x", "y"]
STOP = (0.0, 0.0)


class Rehearsal:
    """A robot and a clock that a test sets: measuring and sleeping take the time that they say."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, command: str = "velocity") -> None:
        from tests.examples.robot_runner import Runner

        self.now, self.sent = 0.0, list[tuple[float, tuple[float, float]]]()
        clock = SimpleNamespace(monotonic=lambda: self.now, sleep=self.pass_time)
        monkeypatch.setattr("tests.examples.robot_runner.time", clock)
        self.runner: Any = object.__new__(Runner)
        self.runner.time_step, self.runner.features = 0.1, FEATURES
        self.runner.number, self.runner._size = 0, 0
        self.runner._body = {"command": command, "dynamics": "holonomic", "max_speed": 0.6,
                             "max_acceleration": 1.0}  # fmt: skip
        self.runner._session = SimpleNamespace(run=lambda names, inputs: [inputs["observation"]])
        self.n_measured = 0
        self.stalls: dict[int, float] = {}  # s, by the number of the measurement
        self.values: dict[int, float] = {}  # of x, likewise

    def pass_time(self, seconds: float) -> None:
        self.now += seconds

    def measure(self) -> dict[str, float]:
        self.now += self.stalls.get(self.n_measured, 0.03)
        x = self.values.get(self.n_measured, 0.5)
        self.n_measured += 1
        return {"x": x, "y": 0.0}

    def send(self, command: tuple[float, float]) -> None:
        self.sent.append((self.now, command))

    def drive(self, seconds: float = 1.0, **options: Any) -> None:
        self.runner.drive(self.measure, self.send, seconds, **options)

    @property
    def gaps(self) -> np.ndarray:
        """Seconds between the commands before the stop."""
        return np.diff([time for time, _ in self.sent[:-1]])


@pytest.fixture
def rehearsal(monkeypatch: pytest.MonkeyPatch) -> Rehearsal:
    return Rehearsal(monkeypatch)


def test_the_loop_keeps_the_rate_and_stops_the_robot(rehearsal: Rehearsal) -> None:
    rehearsal.drive()
    assert [command for _, command in rehearsal.sent] == [(0.3, 0.0)] * 10 + [STOP]
    np.testing.assert_allclose(rehearsal.gaps, 0.1, atol=1e-9)
    assert rehearsal.now == pytest.approx(1.0)


def test_a_stall_is_not_caught_up(rehearsal: Rehearsal) -> None:
    rehearsal.stalls[3] = 0.58
    rehearsal.drive()
    np.testing.assert_allclose(rehearsal.gaps, [0.1, 0.1, 0.65, 0.13, *[0.1] * 5], atol=1e-9)
    assert len(rehearsal.sent) == 11


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_measurement_that_is_no_number_stops_the_robot(
    rehearsal: Rehearsal, value: float
) -> None:
    rehearsal.values[4] = value
    with pytest.raises(ValueError, match="x is NaN or infinite"):
        rehearsal.drive()
    assert [command for _, command in rehearsal.sent] == [(0.3, 0.0)] * 4 + [STOP]


@pytest.mark.parametrize("failure", [OSError("no link"), KeyboardInterrupt()])
def test_a_failure_stops_the_robot(rehearsal: Rehearsal, failure: BaseException) -> None:
    def send(command: tuple[float, float]) -> None:
        rehearsal.send(command)
        if len(rehearsal.sent) == 3:
            raise failure

    with pytest.raises(type(failure)):
        rehearsal.runner.drive(rehearsal.measure, send, 1.0)
    assert [command for _, command in rehearsal.sent] == [(0.3, 0.0)] * 3 + [STOP]


def test_robots_commanded_by_accelerations_need_their_own_stop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rehearsal, stops = Rehearsal(monkeypatch, "acceleration"), list[float]()
    with pytest.raises(ValueError, match="pass `stop`"):
        rehearsal.drive()
    assert not rehearsal.sent
    rehearsal.drive(stop=lambda: stops.append(rehearsal.now))
    assert len(rehearsal.sent) == 10
    assert len(stops) == 1
