"""The order of rows, the values of cells, and scans of several lengths, as a map reads them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from swarmdata.errors import ConversionError
from swarmdata.interop.logs.import_logs import import_logs
from swarmdata.interop.logs.robot_signals import clean_scans
from swarmdata.specs.origins.log_map import ScanSignal
from swarmdata.types import Double
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


def test_headings_that_are_rather_degrees_need_a_unit(tmp_path: Path) -> None:
    logs = each(pose={"heading": {"column": "yaw"}})
    with pytest.raises(ConversionError, match=r"pose of anna run from .* `unit: deg`, or"):
        make(tmp_path, drive(10.0), each=logs)
    assert not (tmp_path / "dataset").exists()
    turned = each(pose={"heading": {"column": "yaw", "unit": "rad"}})
    assert len(make(tmp_path, drive(10.0), each=turned)) > 0


def disordered(n: int) -> dict[str, np.ndarray]:
    """A drive, of which so many rows, 20 a second, run backwards."""
    order = np.arange(200)
    order[50 : 50 + n] = order[50 : 50 + n][::-1]
    return {name: values[order] for name, values in drive(10.0).items()}


def test_small_disorder_is_put_in_order(tmp_path: Path) -> None:
    straight = make(tmp_path, drive(10.0))
    (tmp_path / "b").mkdir()
    assert make(tmp_path / "b", disordered(10)).digest == straight.digest


def test_the_row_is_that_of_the_file(tmp_path: Path) -> None:
    columns = {**drive(10.0), "id": np.tile([7, 8], 100)}
    columns["t"][150:] -= 5.0
    with pytest.raises(ConversionError, match="row 151: time"):
        make(tmp_path, columns, each={**MAP["each"], "rows": {"id": 7}})


def test_a_signal_may_allow_more(tmp_path: Path) -> None:
    columns = disordered(40)
    with pytest.raises(ConversionError, match="row 52: time runs back by"):
        make(tmp_path, columns, max_gap=0.01)
    wide = {name: {**MAP["each"][name], "max_gap": 3.0} for name in ("pose", "command")}
    make(tmp_path, columns, max_gap=0.01, each=each(**wide))


def test_general_quaternions_and_those_of_zeros(tmp_path: Path) -> None:
    columns = drive(10.0)
    yaw = np.deg2rad(columns.pop("yaw"))
    names = ("qx", "qy", "qz", "qw")
    parts = np.stack([0 * yaw, 0 * yaw, np.sin(yaw / 2), np.cos(yaw / 2)])
    columns |= dict(zip(names, 1.05 * parts, strict=True))
    quaternion = each(pose={"quaternion": names})
    dataset = make(tmp_path, columns, each=quaternion)
    heading = np.arctan2(*dataset[0].observations[:, 0, [3, 2]].T)
    expected = np.unwrap(yaw)[:200:2][: len(heading)]
    np.testing.assert_allclose(np.unwrap(heading), expected, atol=1e-5)
    for name in names:
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


RANGES: list[Double] = list(
    np.array([[1.0, 2.0, np.inf, 9.0], [0.01, 2.0, 3.0, 4.0], [1.0, np.nan, -np.inf, 2.0]])
)


def scan(**changes: object) -> ScanSignal:
    return ScanSignal.parse({"range_min": 0.1, "range_max": 5.0, **changes})


def circle(sizes: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Angles of scans all around, from behind to behind, as drivers of 2D lidars write them."""
    return np.full(len(sizes), -np.pi), 2 * np.pi / (np.array(sizes) - 1)


def facing(sizes: Sequence[int]) -> list[np.ndarray]:
    """Scans of a wall to the left (angles from 0 to pi), and of nothing to the right."""
    return [np.where(np.linspace(-np.pi, np.pi, n) > 1e-9, 1.0, np.inf) for n in sizes]


FOUR, TWO_SCANS = np.arange(1.0, 5.0), [np.ones(4), np.ones(1)]


@pytest.mark.parametrize(
    ("rows", "changes", "angles", "expected"),
    [
        (RANGES[:1], {}, None, [[1, 2, 5, 5]]),
        (RANGES[1:], {"invalid": "nothing"}, None, [[5, 2, 3, 4], [1, 5, 5, 2]]),
        (RANGES[:1], {"beams": 2}, None, [[1, 5]]),
        (RANGES[:1], {"beams": 3}, None, [[1, 2, 5]]),
        ([FOUR, FOUR[::3]], {"beams": 2}, ([0.0, 0.1], [0.1, 0.2]), [[1, 3], [1, 4]]),
        ([FOUR, np.roll(FOUR, 2)], {"beams": 4}, ([0.0, np.pi], [np.pi / 2] * 2), [FOUR, FOUR]),
        (TWO_SCANS, {"beams": 2}, ([0.0] * 2, [0.1] * 2), [[1, 1], [1, np.nan]]),
        (TWO_SCANS, {"beams": 2, "invalid": "nothing"}, ([0.0] * 2, [0.1] * 2), [[1, 1], [1, 5]]),
    ],
    ids=[
        "infinite is nothing in range", "invalid beams may be nothing", "sectors have the nearest",
        "also of unequal size", "half the beams by their angles", "the start of a turn is nothing",
        "a sector without a beam is unknown", "or nothing",
    ],
)  # fmt: skip
def test_scans(rows: Any, changes: dict[str, Any], angles: Any, expected: Any) -> None:
    turns: Any = None if angles is None else tuple(np.array(each) for each in angles)
    assert_array_equal(clean_scans(rows, scan(**changes), "anna", turns), expected)


def test_invalid_beams_are_not_known() -> None:
    unknown = clean_scans(RANGES, scan(), "anna")
    assert_array_equal(np.isnan(unknown).sum(axis=1), [0, 1, 2])


def test_scans_that_differ_in_their_beams_are_divided_by_angle() -> None:
    sizes = (36, 37, 36, 0, 38)
    rows = [np.zeros(0) if not n else facing([n])[0] for n in sizes]
    found = clean_scans(rows, scan(beams=4), "anna", circle([n or 2 for n in sizes]))
    for k in (0, 1, 2, 4):
        assert_array_equal(found[k], [5, 5, 1, 1])
    assert np.isnan(found[3]).all()  # nothing is known of a scan without beams


@pytest.mark.parametrize(
    ("rows", "angles", "beams", "words"),
    [
        (facing([36, 37]), circle([36, 37]), None, "36 to 37 beams; say into how many sectors"),
        (facing([36, 37]), None, 4, "no columns say at which angles"),
        (facing([36, 37]), (np.zeros(2), np.zeros(2)), 4, "no columns say at which angles"),
        (facing([4, 4]), (np.array([0.0, 0.5]), np.full(2, 0.1)), 4, "scan 2 of .* beams outside"),
        ([np.zeros(0)], None, None, "have no beams"),
        (RANGES, None, 5, "4 beams, too few for 5 sectors"),
    ],
)
def test_scans_that_cannot_be_divided(rows: Any, angles: Any, beams: Any, words: str) -> None:
    with pytest.raises(ConversionError, match=words):
        clean_scans(rows, scan(beams=beams), "anna", angles)
