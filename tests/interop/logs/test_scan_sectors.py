"""What is read of a scan."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from swarmdata.errors import ConversionError
from swarmdata.interop.logs.robot_signals import clean_scans
from swarmdata.specs.origins.log_map import ScanSignal
from swarmdata.types import Double

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


def test_infinite_is_nothing_in_range() -> None:
    assert_array_equal(clean_scans(RANGES[:1], scan(), "anna"), [[1, 2, 5, 5]])


def test_invalid_beams_are_not_known_or_nothing() -> None:
    unknown = clean_scans(RANGES, scan(), "anna")
    assert_array_equal(np.isnan(unknown).sum(axis=1), [0, 1, 2])
    found = clean_scans(RANGES, scan(invalid="nothing"), "anna")
    assert_array_equal(found[1:], [[5, 2, 3, 4], [1, 5, 5, 2]])


def test_sectors_keep_the_nearest() -> None:
    assert_array_equal(clean_scans(RANGES[:1], scan(beams=2), "anna"), [[1, 5]])
    assert_array_equal(clean_scans(RANGES[:1], scan(beams=3), "anna"), [[1, 2, 5]])
    with pytest.raises(ConversionError, match="4 beams, too few for 5 sectors"):
        clean_scans(RANGES, scan(beams=5), "anna")


def test_scans_that_differ_in_their_beams_are_divided_by_angle() -> None:
    sizes = (36, 37, 36, 0, 38)
    rows = [np.zeros(0) if not n else facing([n])[0] for n in sizes]
    found = clean_scans(rows, scan(beams=4), "anna", circle([n or 2 for n in sizes]))
    for k in (0, 1, 2, 4):
        assert_array_equal(found[k], [5, 5, 1, 1])
    assert np.isnan(found[3]).all()  # nothing is known of a scan without beams


def test_a_scan_of_half_the_beams_is_divided_by_its_angles() -> None:
    rows = [np.arange(1.0, 5.0), np.array([1.0, 4.0])]
    angles = np.array([0.0, 0.1]), np.array([0.1, 0.2])  # the second misses the first and third
    assert_array_equal(clean_scans(rows, scan(beams=2), "anna", angles), [[1, 3], [1, 4]])


def test_the_start_of_a_full_turn_does_not_matter() -> None:
    angles = np.array([0.0, np.pi]), np.full(2, np.pi / 2)
    rows = [np.arange(1.0, 5.0), np.array([3.0, 4.0, 1.0, 2.0])]
    assert_array_equal(clean_scans(rows, scan(beams=4), "anna", angles), [[1, 2, 3, 4]] * 2)


def test_a_sector_without_a_beam_is_not_known() -> None:
    rows, angles = [np.ones(4), np.ones(1)], (np.zeros(2), np.full(2, 0.1))
    assert_array_equal(clean_scans(rows, scan(beams=2), "anna", angles)[1], [1, np.nan])
    nothing = clean_scans(rows, scan(beams=2, invalid="nothing"), "anna", angles)
    assert_array_equal(nothing[1], [1, 5])


@pytest.mark.parametrize(
    ("rows", "angles", "beams", "words"),
    [
        (facing([36, 37]), circle([36, 37]), None, "36 to 37 beams; say into how many sectors"),
        (facing([36, 37]), None, 4, "no columns say at which angles"),
        (facing([36, 37]), (np.zeros(2), np.zeros(2)), 4, "no columns say at which angles"),
        (
            facing([4, 4]),
            (np.array([0.0, 0.5]), np.full(2, 0.1)),
            4,
            "scan 2 of anna has beams out",
        ),
        ([np.zeros(0)], None, None, "have no beams"),
    ],
)
def test_scans_that_cannot_be_divided(
    rows: list[np.ndarray],
    angles: tuple[np.ndarray, np.ndarray] | None,
    beams: int | None,
    words: str,
) -> None:
    with pytest.raises(ConversionError, match=words):
        clean_scans(rows, scan(beams=beams), "anna", angles)
