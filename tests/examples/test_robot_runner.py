"""The runner of the documentation drives robots as the policy itself would, and stops them."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import swarmdata
from swarmdata.cli.main import app
from swarmdata.datasets.dataset import Dataset
from tests.examples.robot_runner import Runner
from tests.support.tiny import make_tiny


@pytest.mark.slow
@pytest.mark.parametrize("name", ["policy.onnx", "policy.py"])
@pytest.mark.parametrize("memory", [[], ["--set", "memory=gru", "--set", "window=4"]])
def test_a_team_of_runners(memory: list[str], name: str, tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="algorithms need torch")
    if name == "policy.onnx":
        pytest.importorskip("onnxruntime", reason="the group 'interop'")
        pytest.importorskip("onnxscript", reason="the extra 'onnx'")
    from swarmdata.learn.training.run_folder import load_run

    make_tiny(tmp_path / "tiny")
    run, file = tmp_path / "run", tmp_path / name
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


STOP = (0.0, 0.0)
ABOUT = {
    "robots": ["robot_0"], "features": {"robot_0": ["x", "y"]}, "memory": 1, "time_step": 0.1,
    "commands": [{"middle": [0.0, 0.0], "half": [0.6, 0.6], "norm": None, "stop": [0.0, 0.0]}],
}  # fmt: skip
POLICY = """
import numpy as np
class Policy:
    about = {about}
    def step(self, observation, robot, memory):
        return observation * (1.0 if observation[0] > 0 else np.nan), memory + 1
"""
"""Drives at its measurement; of one below 0 it makes NaN."""


class Rehearsal:
    """A simulated robot and a clock: measuring and sleeping take the time that they say.

    Its motors hold a command until the next one, so a robot that nobody stops drives on.
    """

    def __init__(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch, stop: list[float] | None
    ) -> None:
        self.now, self.sent = 0.0, list[tuple[float, tuple[float, ...]]]()
        clock = SimpleNamespace(monotonic=lambda: self.now, sleep=self.pass_time)
        monkeypatch.setattr("tests.examples.robot_runner.time", clock)
        about = {**ABOUT, "commands": [{**ABOUT["commands"][0], "stop": stop}]}  # type: ignore[index]
        path = folder / "policy.py"
        path.write_text(POLICY.replace("{about}", repr(about)))
        self.runner = Runner(str(path), "robot_0")
        self.n_measured = 0
        self.stalls: dict[int, float] = {}  # s, by the number of the measurement
        self.values: dict[int, float | None] = {}  # of x, likewise; None: the message is lost

    def pass_time(self, seconds: float) -> None:
        assert seconds >= 0
        self.now += seconds

    def measure(self) -> dict[str, float]:
        self.now += self.stalls.get(self.n_measured, 0.03)
        x = self.values.get(self.n_measured, 0.5)
        self.n_measured += 1
        return {"y": 0.0} if x is None else {"x": x, "y": 0.0}

    def send(self, command: tuple[float, ...]) -> None:
        assert np.isfinite(command).all()
        self.sent.append((self.now, command))

    def drive(self, seconds: float = 1.0, **options: Any) -> None:
        self.runner.drive(self.measure, self.send, seconds, **options)

    @property
    def gaps(self) -> np.ndarray:
        """Seconds between the commands before the stop."""
        return np.diff([time for time, _ in self.sent[:-1]])


@pytest.fixture
def rehearsal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rehearsal:
    return Rehearsal(tmp_path, monkeypatch, [0.0, 0.0])


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


@pytest.mark.parametrize(
    ("step", "value", "error", "words"),
    [
        (4, np.nan, ValueError, "x is NaN or infinite"),
        (4, np.inf, ValueError, "x is NaN or infinite"),
        (4, -0.5, ValueError, "the policy's action is"),
        (2, None, KeyError, "x"),  # a lost message
    ],
)
def test_what_is_no_number_stops_the_robot(
    rehearsal: Rehearsal, step: int, value: float | None, error: type[Exception], words: str
) -> None:
    rehearsal.values[step] = value
    with pytest.raises(error, match=words):
        rehearsal.drive()
    assert [command for _, command in rehearsal.sent] == [(0.3, 0.0)] * step + [STOP]
    assert rehearsal.runner._memory.tolist() == [step]  # what follows goes on from the last action


def test_every_drive_of_a_bad_day_ends_with_a_robot_that_stands(rehearsal: Rehearsal) -> None:
    """Stalls, losses and NaN at random: never a burst, never a command that is no number."""
    rng, n_ended = np.random.default_rng(0), 0
    for _ in range(50):
        draws, rehearsal.n_measured = rng.random(30), 0
        rehearsal.stalls = {int(k): 0.7 for k in np.flatnonzero(draws < 0.1)}
        rehearsal.values = dict.fromkeys(np.flatnonzero(draws > 0.98).tolist(), None)
        rehearsal.values |= dict.fromkeys(np.flatnonzero(draws > 0.99).tolist(), np.nan)
        rehearsal.sent.clear()
        rehearsal.runner.forget()
        try:
            rehearsal.drive(3.0)
        except (ValueError, KeyError):
            n_ended += 1
        assert rehearsal.sent[-1][1] == STOP
        assert all(command != STOP for _, command in rehearsal.sent[:-1])
        assert (rehearsal.gaps > 0.1 - 1e-9).all()
    assert 10 < n_ended < 50


@pytest.mark.parametrize("failure", [OSError("no link"), KeyboardInterrupt()])
def test_a_failure_stops_the_robot(rehearsal: Rehearsal, failure: BaseException) -> None:
    def send(command: tuple[float, ...]) -> None:
        rehearsal.send(command)
        if len(rehearsal.sent) == 3:
            raise failure

    with pytest.raises(type(failure)):
        rehearsal.runner.drive(rehearsal.measure, send, 1.0)
    assert [command for _, command in rehearsal.sent] == [(0.3, 0.0)] * 3 + [STOP]


def test_robots_commanded_by_accelerations_need_their_own_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rehearsal, stops = Rehearsal(tmp_path, monkeypatch, None), list[float]()
    with pytest.raises(ValueError, match="pass `stop`"):
        rehearsal.drive()
    assert not rehearsal.sent
    rehearsal.drive(stop=lambda: stops.append(rehearsal.now))
    assert len(rehearsal.sent) == 10
    assert len(stops) == 1


@pytest.mark.parametrize(
    ("norm", "expected"), [(None, (0.6, 0.48)), (2, (0.46852, 0.37481)), (1, (0.33333, 0.26667))]
)
def test_commands_are_limited_as_in_training(
    rehearsal: Rehearsal, norm: int | None, expected: tuple[float, float]
) -> None:
    rehearsal.runner._command = {**rehearsal.runner._command, "norm": norm}
    found = rehearsal.runner.command(np.array([1.0, 0.8], np.float32))
    np.testing.assert_allclose(found, expected, rtol=1e-4)
