"""The order of rows, the values of cells, and scans of several lengths, as a map reads them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.errors import ConversionError
from swarmdata.interop.logs import import_logs
from tests.interop.logs.logged_team import MAP, drive, each, log_map, write_csv

ID = "hall-monday-v0"


def make(folder: Path, columns: dict[str, Any], **changes: Any) -> Any:
    """A dataset of one robot."""
    log = write_csv(folder / "anna.csv", columns)
    return import_logs(log, folder / "dataset", log_map=log_map(robots=["anna"], **changes), id=ID)


def test_two_drives_in_one_file_are_refused(tmp_path: Path) -> None:
    first, second = drive(10.0), drive(10.0, 2.0)
    jitter = np.random.default_rng(0).uniform(0, 0.01, 200)
    columns = {name: np.concatenate([first[name], second[name]]) for name in first}
    columns["t"][200:] += jitter
    with pytest.raises(ConversionError, match=r"anna\.csv, row 201: time runs back by 9\.9\d* s"):
        make(tmp_path, columns)
    assert not (tmp_path / "dataset").exists()


def test_small_disorder_is_put_in_order(tmp_path: Path) -> None:
    columns = drive(10.0)
    straight = make(tmp_path, columns)
    order = np.arange(200)
    order[50:60] = order[50:60][::-1]  # half a second
    columns = {name: values[order] for name, values in columns.items()}
    (tmp_path / "b").mkdir()
    assert make(tmp_path / "b", columns).digest == straight.digest


def test_the_row_is_that_of_the_file(tmp_path: Path) -> None:
    columns = {**drive(10.0), "id": np.tile([7, 8], 100)}
    columns["t"][150:] -= 5.0
    with pytest.raises(ConversionError, match="row 151: time"):
        make(tmp_path, columns, each={**MAP["each"], "rows": {"id": 7}})


def test_a_signal_may_allow_more(tmp_path: Path) -> None:
    columns = drive(10.0)
    order = np.arange(200)
    order[50:90] = order[50:90][::-1]
    columns = {name: values[order] for name, values in columns.items()}
    with pytest.raises(ConversionError, match="row 52: time runs back by"):
        make(tmp_path, columns, max_gap=0.01)
    wide = {name: {**MAP["each"][name], "max_gap": 3.0} for name in ("pose", "command")}
    make(tmp_path, columns, max_gap=0.01, each=each(**wide))


def test_general_quaternions_and_those_of_zeros(tmp_path: Path) -> None:
    columns = drive(10.0)
    yaw = np.deg2rad(columns.pop("yaw"))
    for name, part in zip(
        ("qx", "qy", "qz", "qw"), (0 * yaw, 0 * yaw, np.sin(yaw / 2), np.cos(yaw / 2)), strict=True
    ):
        columns[name] = 1.05 * part
    quaternion = each(pose={"quaternion": ["qx", "qy", "qz", "qw"]})
    dataset = make(tmp_path, columns, each=quaternion)
    heading = np.arctan2(*dataset[0].observations[:, 0, [3, 2]].T)
    np.testing.assert_allclose(
        np.unwrap(heading), np.unwrap(yaw)[:200:2][: len(heading)], atol=1e-5
    )
    for name in ("qx", "qy", "qz", "qw"):
        columns[name] = np.where((columns["t"] > 1004) & (columns["t"] < 1006), 0.0, columns[name])
    (tmp_path / "b").mkdir()
    gaps = make(tmp_path / "b", columns, each=quaternion, gaps="cut")
    assert [len(episode) for episode in gaps] == [40, 39]  # nothing is known for two seconds


@pytest.mark.parametrize("cell", ["1_0_0.5", "٣", "1e999"])
def test_numbers_that_no_logger_writes(tmp_path: Path, cell: str) -> None:
    columns: dict[str, Any] = {name: values.astype(object) for name, values in drive(10.0).items()}
    for name in ("x", "t"):
        changed = columns[name].copy()
        changed[5] = cell
        with pytest.raises(ConversionError, match=r"anna\.csv"):
            make(tmp_path, {**columns, name: changed})


def test_values_beyond_float32_are_refused(tmp_path: Path) -> None:
    columns = drive(10.0)
    columns["x"][7] = 1e39
    with pytest.raises(ConversionError, match=r"pose of anna .* infinite"):
        make(tmp_path, columns)


def test_a_column_without_a_name(tmp_path: Path) -> None:
    columns = {"": np.arange(200), **drive(10.0)}
    with pytest.raises(ConversionError, match=r"no name for column 1, perhaps .* pandas"):
        make(tmp_path, columns)
