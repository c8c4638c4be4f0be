"""A twin that is fitted to logs answers commands as the logged robots did."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import swarmdata
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.logs.fitted_twin import Twin, fit_twin
from swarmdata.interop.logs.logged_drives import Response
from swarmdata.specs.task_spec import TaskSpec
from tests.interop.logs.driven_robots import (
    DT,
    LARGEST,
    MAP,
    NAMES,
    log_map,
    played,
    random_commands,
    simulated,
    write_logs,
)
from tests.support.command_line import run

TRUE = (
    Response(speed_gain=0.8, turn_gain=1.1, lag=0.15, delay=2),
    Response(speed_gain=1.0, turn_gain=0.9, lag=0.15, delay=2),
)
NOISE = 0.002  # m and rad, of poses


def logged(folder: Path, seed: int = 0, **changes: Any) -> Dataset:
    """Two minutes of both robots."""
    without, still = changes.pop("without", slice(0, 0)), changes.pop("still", False)
    commands = random_commands(1200, seed)
    poses = played(simulated(TRUE), commands)
    if still:
        poses[:, 1] = poses[0, 1]
    poses = poses + np.random.default_rng(seed).normal(0, NOISE, poses.shape)
    logs = write_logs(folder, poses, commands, without)
    return swarmdata.import_logs(
        logs, folder / "data", log_map=log_map(**changes), id="hall-drive-v0"
    )


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return logged(tmp_path_factory.mktemp("one"))


@pytest.fixture(scope="module")
def twin(dataset: Dataset) -> Twin:
    return fit_twin(dataset)


@pytest.mark.slow
def test_each_robot_has_the_response_that_it_had(twin: Twin) -> None:
    assert not twin.flags
    for name, true in zip(NAMES, TRUE, strict=True):
        found = twin.responses[name]
        assert_allclose(found.speed_gain, true.speed_gain, rtol=0.02)
        assert_allclose(found.turn_gain, true.turn_gain, rtol=0.02)
        assert_allclose(found.delay * DT + found.lag, true.delay * DT + true.lag, atol=0.03)
    assert_allclose([twin.sources.position, twin.sources.heading], NOISE, rtol=0.2)


@pytest.mark.slow
def test_the_spec_has_the_fit(twin: Twin) -> None:
    spec = twin.spec
    for role, name in zip(spec.team, NAMES, strict=True):
        found = twin.responses[name]
        assert role.name == name
        assert role.robot.command_delay == found.delay
        assert_allclose(role.robot.max_speed, found.speed_gain * LARGEST[0], atol=1e-4)
        assert_allclose(role.robot.max_turn_rate, found.turn_gain * LARGEST[1], atol=1e-4)
        assert_allclose(role.robot.actuator_lag, found.lag, atol=1e-4)
        low, high = spec.randomization.ranges["max_speed"]
        assert low <= role.robot.max_speed <= high
    assert_allclose(spec.observation.noise.position, NOISE, rtol=0.2)
    slowest = min(role.robot.max_speed for role in spec.team)
    assert spec.horizon * DT * slowest > np.hypot(spec.arena.width, spec.arena.height)
    assert TaskSpec.from_text(twin.to_yaml()) == spec


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["kinematic", "pymunk"])
def test_the_twin_drives_as_the_robots_did(twin: Twin, backend: str) -> None:
    """Under the same commands; they start elsewhere, so that lengths are compared, and turns."""
    commands = random_commands(30, 7)
    changes: Mapping[str, Any] = {"backend": backend, "randomization": {}}
    robots = played(simulated(TRUE), commands)
    drives = played(twin.spec.with_updates(**changes, arena={"width": 50, "height": 50}), commands)
    moved = [np.linalg.norm((each[-1] - each[0])[:, :2], axis=-1) for each in (robots, drives)]
    turned = [np.unwrap(each[..., 2], axis=0) for each in (robots, drives)]
    assert moved[0].max() > 0.3
    assert_allclose(moved[1], moved[0], atol=0.02)
    assert_allclose(turned[1][-1] - turned[1][0], turned[0][-1] - turned[0][0], atol=0.05)


def test_the_twin_predicts_another_run_and_the_commands_alone_do_not(
    twin: Twin, tmp_path: Path
) -> None:
    found = twin.check(logged(tmp_path, seed=1))
    distance, angle, close = found["twin"].estimates
    assert distance.high < 0.01
    assert angle.high < 1.0
    assert close.value == 1.0
    closer, straighter = found["twin"].less(found["commands as they are"])
    assert closer.high < -0.03
    assert straighter.high < -3.0
    assert found["no motion"].estimates[0].low > 0.2


@pytest.mark.slow
def test_drift_takes_the_place_of_noise(dataset: Dataset) -> None:
    spec = fit_twin(dataset, drift=True, radius=0.2).spec
    assert spec.observation.drift.turning > 0
    assert spec.observation.noise.position == 0
    assert spec.team[0].robot.radius == 0.2


@pytest.mark.slow
def test_a_robot_that_never_moves_is_flagged(tmp_path: Path) -> None:
    twin = fit_twin(logged(tmp_path, still=True))
    assert list(twin.flags) == ["bert"]
    assert "0% of the displacements" in twin.flags["bert"]
    assert twin.responses["bert"] == twin.responses["anna"] == twin.team.response
    assert_allclose(twin.team.response.speed_gain, TRUE[0].speed_gain, rtol=0.02)


@pytest.mark.slow
def test_missing_rows_leave_the_rest(tmp_path: Path) -> None:
    twin = fit_twin(logged(tmp_path / "some", without=slice(300, 700)))
    assert not twin.flags
    assert_allclose(twin.responses["bert"].speed_gain, TRUE[1].speed_gain, rtol=0.02)
    twin = fit_twin(logged(tmp_path / "most", without=slice(15, 1190)))
    assert list(twin.flags) == ["bert"]
    assert "too few" in twin.flags["bert"]


def test_commands_that_explain_nothing_are_refused(tmp_path: Path) -> None:
    commands = random_commands(600, 0)
    logs = write_logs(tmp_path, played(simulated(TRUE), random_commands(600, 1)), commands)
    dataset = swarmdata.import_logs(logs, tmp_path / "a", log_map=log_map(), id="hall-drive-v0")
    with pytest.raises(ConversionError, match="does not determine"):
        fit_twin(dataset)


def test_too_little_is_refused(tmp_path: Path) -> None:
    dataset = logged(tmp_path, episodes={"length": 2})
    with pytest.raises(ConversionError, match="fewer than 20 stretches of 3 s"):
        fit_twin(dataset)


def test_what_has_no_commands_is_refused(tmp_path: Path, tiny: Path) -> None:
    with pytest.raises(ConversionError, match="expected a dataset that `swarmdata import`"):
        fit_twin(Dataset.open(tiny))
    v, omega = MAP["each"]["command"]["components"]
    guessed = {"components": [v, omega], "differences": True, "outside": "clip"}
    aside = {"components": [v | {"motion": "vy"}, omega]}
    each = MAP["each"]
    with pytest.raises(ConversionError, match="differences of its poses"):
        fit_twin(logged(tmp_path / "a", each={**each, "command": guessed}, ignore=["v", "omega"]))
    with pytest.raises(ConversionError, match="are vy, omega, expected v and omega"):
        fit_twin(logged(tmp_path / "b", each={**each, "command": aside}))


def test_another_team_is_refused(twin: Twin, tmp_path: Path) -> None:
    with pytest.raises(ConversionError, match=r"steps of 0\.2 s, expected anna, bert in steps"):
        twin.check(logged(tmp_path, dt=0.2))


@pytest.mark.slow
def test_the_command_writes_a_spec(dataset: Dataset, tmp_path: Path) -> None:
    out = tmp_path / "twin.yaml"
    result = run("fit", str(dataset.path), "--out", str(out))
    assert "held-out episodes" in result
    assert TaskSpec.from_file(out).n_agents == 2
    again = run("fit", str(dataset.path), "--out", str(out), code=1)
    assert "exists" in again
