"""Static transforms in the plane."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from swarmdata.errors import ConversionError
from swarmdata.interop.logs.planar_frames import PlanarFrames, yaw_of
from swarmdata.interop.logs.resampling import Samples
from swarmdata.specs.origins.log_map import StaticTransform


def transform(frame: str, parent: str, **pose: float) -> StaticTransform:
    return StaticTransform(frame=frame, parent=parent, **pose)


def test_a_chain_of_frames_is_followed() -> None:
    quarter = np.pi / 2
    frames = PlanarFrames(
        "map", [transform("odom", "hall", x=1, heading=quarter), transform("hall", "map", y=2)]
    )
    points = frames.points(Samples(np.arange(1), np.array([[3.0, 0.5]])), "odom", "poses")
    assert_allclose(points.values, [[1 - 0.5, 3 + 2]], atol=1e-12)
    assert_allclose(frames.pose_of("odom", "poses"), (1, 2, quarter))
    assert frames.pose_of("", "poses") == frames.pose_of("map", "poses") == (0, 0, 0)


@pytest.mark.parametrize("parent", ["nowhere", "odom"])
def test_a_frame_without_a_way_to_the_world_is_refused(parent: str) -> None:
    frames = PlanarFrames("map", [transform("odom", parent)])
    with pytest.raises(ConversionError, match="poses of anna are in the frame 'odom', and no"):
        frames.pose_of("odom", "poses of anna")


def test_the_first_of_two_transforms_wins() -> None:
    frames = PlanarFrames("map", [transform("odom", "map", x=1), transform("odom", "map", x=2)])
    assert frames.pose_of("odom", "poses")[0] == 1


def test_yaws_of_quaternions_of_any_norm_and_tilt() -> None:
    angles = np.deg2rad([90.0, 90.0, -120.0])
    norms = np.array([1.05, 2.0, 1e-3])
    zeros = np.zeros(3)
    found = yaw_of(zeros, zeros, norms * np.sin(angles / 2), norms * np.cos(angles / 2))
    assert_allclose(found, angles)
    # of Z-Y-X angles: yaw 0.7, pitch 0.3, roll -0.4
    (cy, cp, cr), (sy, sp, sr) = (f(np.array([0.7, 0.3, -0.4]) / 2) for f in (np.cos, np.sin))
    tilted = (sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
              cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy)  # fmt: skip
    assert_allclose(yaw_of(*(np.array([1.7 * each]) for each in tilted)), 0.7)


def test_what_has_no_yaw() -> None:
    half = np.sqrt(0.5)
    odd = [[0, 0, 0, 0], [0, half, 0, half], [0, 0, 0, np.nan], [0, 0, 0, np.inf], [0, 0, 1e200, 1]]
    x, y, z, w = np.array(odd).T
    assert np.isnan(yaw_of(x, y, z, w)).all()  # of no norm, looking up, and no numbers


def test_a_slash_before_a_frame_does_not_matter() -> None:
    frames = PlanarFrames("/map", [transform("/odom", "map", x=1)])
    assert frames.pose_of("odom", "poses") == frames.pose_of("/odom", "poses") == (1, 0, 0)
    assert frames.pose_of("map", "poses") == frames.pose_of("/map", "poses") == (0, 0, 0)
