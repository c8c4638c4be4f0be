"""Scans as rows of one width: ranges that are valid, and the nearest of each sector."""

from collections.abc import Iterator, Sequence

import numpy as np

from swarmdata.errors import ConversionError
from swarmdata.specs.origins.log_map import ScanSignal
from swarmdata.types import Double, Int


def clean_scans(
    rows: Sequence[Double], scan: ScanSignal, name: str, angles: tuple[Double, Double] | None = None
) -> Double:
    """Ranges in [range_min, range_max], the smallest of each sector; unknown scans are NaN.

    REP 117 of ROS: `inf` is nothing in range, `-inf` too near to measure, NaN an invalid range. The
    sectors divide the field of view of the first scan. A scan without beams is unknown.

    Args:
        rows: ranges of each scan as they were logged, m, [B] each.
        scan: what the map says of them.
        name: of the robot, for errors.
        angles: of the first beam of each scan, and between its beams, rad, [n] each; None, or 0
            between beams: every scan has the same beams.

    Returns:
        [n, sectors], or [n, B] where the map names no sectors.

    Raises:
        ConversionError: scans differ in their beams and the map names no sectors, there are fewer
            beams than sectors, or beams are outside the field of view.
    """
    sizes = {len(row) for row in rows if len(row)}
    if not sizes:
        raise ConversionError(f"the scans of {name} have no beams")
    if scan.beams is None and len(sizes) > 1:
        raise ConversionError(
            f"scans of {name} have {min(sizes)} to {max(sizes)} beams; say into how many sectors "
            "they are divided, `beams` of the map"
        )
    n_sectors = scan.beams or max(sizes)
    if n_sectors > max(sizes):
        raise ConversionError(
            f"scans of {name} have {max(sizes)} beams, too few for {n_sectors} sectors; choose "
            "fewer `beams`"
        )
    found = np.full((len(rows), n_sectors), np.inf)
    places = _sectors(rows, n_sectors, angles if scan.beams else None, name)
    for row, ranges, sectors in zip(found, rows, places, strict=True):
        with np.errstate(invalid="ignore"):  # a sector with an unknown beam is unknown
            np.minimum.at(row, sectors, _valid(ranges, scan))
        if not len(ranges):
            row[:] = np.nan
    found[np.isinf(found)] = np.nan if scan.invalid == "unknown" else scan.range_max  # no beam
    return found


def _sectors(
    rows: Sequence[Double], n_sectors: int, angles: tuple[Double, Double] | None, name: str
) -> Iterator[Int]:
    """The sector of every beam of each scan, [B] each.

    Raises:
        ConversionError: beams are outside the field of view, or differ in number without angles.
    """
    sizes = np.array([len(row) for row in rows])
    first = int(np.argmax(sizes > 0))
    n_beams = int(sizes[first])
    is_alike = bool(np.isin(sizes, (0, n_beams)).all())
    if angles is None or not (np.isfinite(angles).all() and angles[1][sizes > 0].all()):
        if not is_alike:
            raise ConversionError(
                f"scans of {name} differ in their number of beams, and no columns say at which "
                "angles these are (`angle_min` and `angle_increment` of a LaserScan)"
            )
        angles = np.zeros(len(rows)), np.ones(len(rows))
    starts, steps = angles  # rad, or beams
    low, width = starts[first] - steps[first] / 2, steps[first] * n_beams
    is_circle = abs(width) > 2 * np.pi - 1.5 * abs(steps[first])
    for k, size in enumerate(sizes.tolist()):
        places = (starts[k] + steps[k] * np.arange(size) - low) / width
        if is_circle:
            places %= 1.0
        elif size and max(-places.min(), places.max() - 1) > 1 / n_beams:
            raise ConversionError(
                f"scan {k + 1} of {name} has beams outside the field of view of the first one"
            )
        yield np.floor(places * n_sectors).astype(np.int64).clip(0, n_sectors - 1)


def _valid(ranges: Double, scan: ScanSignal) -> Double:
    """Ranges, of which those that are not known are NaN."""
    invalid = np.isnan(ranges) | (ranges < scan.range_min)
    found: Double = np.where(invalid, scan.range_max, ranges).clip(max=scan.range_max)
    if scan.invalid == "unknown":
        found[invalid] = np.nan
    return found
