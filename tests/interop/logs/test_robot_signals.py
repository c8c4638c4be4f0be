"""What is read of a scan."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from swarmdata.errors import ConversionError
from swarmdata.interop.logs.robot_signals import clean_scans
from swarmdata.specs.origins.log_map import ScanSignal

RANGES = np.array([[1.0, 2.0, np.inf, 9.0], [0.01, 2.0, 3.0, 4.0], [1.0, np.nan, -np.inf, 2.0]])


def scan(**changes: object) -> ScanSignal:
    return ScanSignal.parse({"range_min": 0.1, "range_max": 5.0, **changes})


def test_infinite_is_nothing_in_range() -> None:
    assert_array_equal(clean_scans(RANGES[:1], scan(), "anna"), [[1, 2, 5, 5]])


def test_invalid_beams_are_not_known_or_nothing() -> None:
    unknown = clean_scans(RANGES, scan(), "anna")
    assert_array_equal(np.isnan(unknown).sum(axis=1), [0, 1, 2])
    found = clean_scans(RANGES, scan(invalid="nothing"), "anna")
    assert_array_equal(found[1:], [[5, 2, 3, 4], [1, 5, 5, 2]])


def test_sectors_keep_the_nearest() -> None:
    assert_array_equal(clean_scans(RANGES[:1], scan(beams=2), "anna"), [[1, 5]])
    with pytest.raises(ConversionError, match="4 beams, which 3 sectors do not divide"):
        clean_scans(RANGES, scan(beams=3), "anna")
