"""UTIAS MR.CLAM: the shipped map reads the layout of its files, of which this is a look-alike."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from swarmdata.audit import audit
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.logs import import_logs
from swarmdata.interop.logs.map_files import shipped_maps

BARCODES = {1: 5, 2: 14, 3: 41, 4: 32, 5: 23, 6: 72, 7: 27}
SECONDS, RATE = 50.0, 5.0  # about 250 lines in each file
EPOCH = 1_248_272_272.841


def write_run(folder: Path) -> Path:
    """Five robots on lines; robot 1 measures robot 2 and a landmark, and nobody else."""
    folder.mkdir()
    t = np.arange(round(SECONDS * RATE)) / RATE
    for k in range(1, 6):
        rows = np.stack([EPOCH + t, 0.1 * t, np.full(len(t), float(k)), np.full(len(t), 0.0)], 1)
        write(
            folder / f"Robot{k}_Groundtruth.dat", "Time [s]  x [m]  y [m]  orientation [rad]", rows
        )
        rows = np.stack([EPOCH + t - 0.05, np.full(len(t), 0.1), 0.01 * k + 0 * t], 1)
        write(
            folder / f"Robot{k}_Odometry.dat", "Time [s]  forward v [m/s]  angular v [rad/s]", rows
        )
        seen = [(EPOCH + s, BARCODES[number], 1.0 + number, 0.5) for s in t[20:60:2]
                for number in ((2, 6) if k == 1 else (7,))]  # fmt: skip
        write(folder / f"Robot{k}_Measurement.dat", "Time [s]  Subject #  range [m]  bearing [rad]",
              np.array(seen))  # fmt: skip
    write(folder / "Barcodes.dat", "Subject #  Barcode #", np.array(list(BARCODES.items())))
    write(folder / "Landmark_Groundtruth.dat", "Subject #  x [m]  y [m]  x std-dev  y std-dev",
          np.array([[6, 1.0, 2.0, 0.0, 0.0], [7, 2.0, 2.0, 0.0, 0.0]]))  # fmt: skip
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


def test_five_robots_with_commands(dataset: Dataset) -> None:
    assert audit(dataset.path, progress=False).problems == ()
    assert dataset.spec.agent_names == tuple(f"Robot{k}" for k in range(1, 6))
    assert [len(episode) for episode in dataset] == [200, 200, 96]
    assert_allclose(dataset[0].actions[:, 2], np.tile([0.1, 0.03], (200, 1)))
    names = dataset.spec.observation_spaces(0)[2].model_dump()["spaces"]
    assert "range_2" in names
    assert "range_3" not in names  # itself


def test_measurements_of_robots_are_found_by_their_barcodes(dataset: Dataset) -> None:
    columns = sorted(dataset.spec.observation_spaces(0)[0].model_dump()["spaces"])
    assert "pose" in columns
    places = {name: k + 3 * (name > "pose") for k, name in enumerate(columns)}
    rows = dataset[0].observations[:, 0]
    known = rows[:, places["range_2_known"]] == 1
    time = 0.1 * np.arange(201)
    assert_allclose(known, (time > 3.95) & (time < 12.15), atol=0)
    assert_allclose(rows[known, places["range_2"]], 3.0)
    assert_allclose(rows[known, places["bearing_2"]], 0.5)
    assert not rows[:, places["range_3_known"]].any()


def test_a_robot_without_a_barcode_is_refused(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run")
    text = (run / "Barcodes.dat").read_text()
    (run / "Barcodes.dat").write_text(text.replace("4\t32\n", ""))
    with pytest.raises(ConversionError, match=r"Barcodes\.dat: no row has 4 in column 'subject'"):
        import_logs(run, tmp_path / "dataset", log_map="mrclam", id="mrclam-run_1-v0")


def test_maps_that_are_shipped() -> None:
    assert list(shipped_maps()) == ["mrclam"]
