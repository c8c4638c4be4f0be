"""UTIAS MR.CLAM: the shipped map reads the layout of its files, of which this is a look-alike."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from swarmdata.audit import audit
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.logs.fitted_twin import fit_twin
from swarmdata.interop.logs.import_logs import import_logs, shipped_maps
from swarmdata.specs.origins import RecordedSpec
from swarmdata.specs.origins.log_origin import ImportedLogs
from swarmdata.specs.spaces import bounds

BARCODES = {1: 5, 2: 14, 3: 41, 4: 32, 5: 23, 6: 72, 7: 27}
SECONDS, RATE = 50.0, 10.0  # about 500 lines in each file
EPOCH = 1_248_272_272.841
LAG = 0.2  # s, of the clocks of commands behind that of the poses


def drive(robot: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times from two seconds before the first pose on, the commands in force, and poses."""
    t = np.arange(-2 * RATE, SECONDS * RATE) / RATE
    rng = np.random.default_rng(robot)
    choice = np.searchsorted(np.cumsum(rng.exponential(1.5, 200)) - 2, t, side="right")
    v, omega = rng.choice([0.0, 0.04, 0.086], 200)[choice], rng.uniform(-0.561, 0.57, 200)[choice]
    v[:3], omega[:3] = 0.086, 0.57
    yaw = np.cumsum(np.append(0.0, omega[:-1])) / RATE
    ahead = v[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=1) / RATE
    places = np.cumsum(np.concatenate([[[0.0, robot]], ahead[:-1]]), axis=0)
    return t, np.stack([v, omega], axis=1), np.column_stack([places, yaw])


def write_run(folder: Path) -> Path:
    """Five robots that turn and stop.

    Robot 1 measures robot 2, landmark 6 and a barcode that nothing has, the others landmark 7.
    """
    folder.mkdir()
    for k in range(1, 6):
        t, commands, poses = drive(k)
        seen, times = t >= 0, np.r_[40:120:4, 240:320:4, 440:480:4]
        measured = [(EPOCH + s, code, 1.0 + code / 10, 0.5) for s in t[seen][times]
                    for code in ((14, 72, 99) if k == 1 else (27,))]  # fmt: skip
        places = np.column_stack([EPOCH + t, poses])[seen]
        odometry = np.column_stack([EPOCH + t - LAG, commands])
        for kind, head, rows in (
            ("Groundtruth", "x [m]  y [m]  orientation [rad]", places),
            ("Odometry", "forward v [m/s]  angular v [rad/s]", odometry),
            ("Measurement", "Subject #  range [m]  bearing [rad]", np.array(measured)),
        ):
            write(folder / f"Robot{k}_{kind}.dat", f"Time [s]  {head}", rows)
    write(folder / "Barcodes.dat", "Subject #  Barcode #", np.array(list(BARCODES.items())))
    write(folder / "Landmark_Groundtruth.dat", "Subject #  x [m]  y [m]  x std-dev  y std-dev",
          np.array([[6, 1.0, 2.0, 0.0, 0.0], [7, 2.0, 2.0, 0.0, 0.0]]))  # fmt: skip
    (folder / "barcode_2_id.py").write_text("# comes with some copies of the logs\n")
    return folder


def write(path: Path, head: str, rows: np.ndarray) -> None:
    lines = ["\t".join(f"{value:.3f}".removesuffix(".000") for value in row) for row in rows]
    text = "# UTIAS Multi-Robot Cooperative Localization and Mapping Dataset\n"
    path.write_text(f"{text}# {head}\n" + "".join(f"{line}\n" for line in lines))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("mrclam")
    run = write_run(folder / "MRCLAM_Dataset1")
    return import_logs(run, folder / "dataset", log_map="mrclam", id="mrclam-run_1-v0")


@pytest.mark.slow
def test_five_robots_with_commands_their_clocks_and_bounds(dataset: Dataset) -> None:
    assert audit(dataset.path, progress=False).problems == ()
    assert dataset.spec.agent_names == tuple(f"Robot{k}" for k in range(1, 6))
    lengths = [len(episode) for episode in dataset]
    assert lengths[:2] == [200, 200]
    assert 90 <= lengths[2] <= 97  # what is logged of the last commands
    _, commands, _ = drive(3)
    same = np.isclose(dataset[0].actions[:, 2], commands[20:220], atol=1e-3).all(axis=1)
    assert same.mean() > 0.8  # the others change within a step of the grid
    assert isinstance(dataset.recipe, ImportedLogs)
    assert [clock.robot for clock in dataset.recipe.clocks] == list(dataset.spec.agent_names)
    for clock in dataset.recipe.clocks:
        assert abs(clock.offset - LAG) < 0.02
        assert clock.explained > 0.7
    for space in dataset.spec.action_spaces:
        lows, highs = bounds(space)
        assert_allclose(lows, [0.0, -0.561], atol=0.05)
        assert_allclose(highs, [0.086, 0.57], atol=1e-6)


def test_robots_observe_what_they_measured_in_slots(dataset: Dataset) -> None:
    """The same slots for all robots, in the order of Barcodes.dat, with a mask."""
    spaces = dataset.spec.observation_spaces(0)
    assert all(space == spaces[0] for space in spaces)
    names = ["bearing", "bearing_known", "range", "range_known"]
    assert sorted(spaces[0].model_dump()["spaces"]) == names
    n = len(BARCODES)
    assert dataset[0].observations.shape[2] == 4 * n
    time = 0.1 * np.arange(201)
    seen = (time > 3.95) & (time < 12.15)
    for robot in range(5):
        rows = dataset[0].observations[:, robot].reshape(201, 4, n)
        codes = (14, 72) if robot == 0 else (27,)
        for slot, code in enumerate(BARCODES.values()):
            expected = seen & (code in codes)
            assert_allclose(rows[:, 3, slot], expected, atol=0)
            assert_allclose(rows[:, 1, slot], expected, atol=0)
            assert_allclose(rows[:, 2, slot], expected * (1 + code / 10), rtol=1e-6)
            assert_allclose(rows[:, 0, slot], expected * 0.5)


def test_states_are_the_poses(dataset: Dataset) -> None:
    states = dataset[1].states.reshape(-1, 5, 4)
    assert isinstance(dataset.spec, RecordedSpec)
    assert dataset.spec.state_from == "poses"
    for robot in range(5):
        _, _, poses = drive(robot + 1)
        x, y, yaw = poses[20 + 201 : 20 + 402].T
        expected = np.stack([x, y, np.cos(yaw), np.sin(yaw)], axis=1)
        assert_allclose(states[:, robot], expected, atol=0.01)


@pytest.mark.slow
def test_a_map_may_leave_out_a_robot(dataset: Dataset, tmp_path: Path) -> None:
    """The others observe and do the same, and still have a slot for it."""
    text = shipped_maps()["mrclam"].read_text("utf-8")
    text = text.replace("ignore_logs: [", "ignore_logs: [Robot5_*, ").replace(", Robot5]", "]")
    (tmp_path / "four.yaml").write_text(text, encoding="utf-8")
    run = write_run(tmp_path / "run")
    four = import_logs(run, tmp_path / "d", log_map=tmp_path / "four.yaml", id="mrclam-four-v0")
    assert four.spec.agent_names == dataset.spec.agent_names[:4]
    for ours, all_five in zip(four, dataset, strict=True):
        assert_allclose(ours.observations, all_five.observations[: len(ours) + 1, :4], atol=0)
        assert_allclose(ours.actions, all_five.actions[: len(ours), :4], atol=0)


@pytest.mark.slow
def test_a_twin_is_fitted_to_poses_that_are_states(dataset: Dataset) -> None:
    response = fit_twin(dataset).team.response
    assert_allclose([response.speed_gain, response.turn_gain], 1.0, atol=0.03)


def test_a_barcode_that_is_listed_twice_is_refused(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    text = (run / "Barcodes.dat").read_text()
    (run / "Barcodes.dat").write_text(text.replace("4\t32\n", "4\t5\n"))
    with pytest.raises(ConversionError, match=r"Barcodes\.dat lists 5 several times"):
        import_logs(run, tmp_path / "dataset", log_map="mrclam", id="mrclam-run_1-v0")
