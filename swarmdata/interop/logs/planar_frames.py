"""Frames that stand still in each other, in the plane: poses of one become poses of the world."""

from collections.abc import Iterable

import numpy as np

from swarmdata.errors import ConversionError
from swarmdata.interop.logs.resampling import Samples
from swarmdata.specs.origins.log_map import StaticTransform
from swarmdata.types import Double

LEAST_LEVEL = 1e-6
"""Least share of a quaternion's norm, squared, that the turned x axis has in the plane."""


def yaw_of(x: Double, y: Double, z: Double, w: Double) -> Double:
    """The Z of Z-Y-X angles of quaternions of any norm, rad, [n].

    Where the norm is 0, or the x axis points up or down, there is none: NaN.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # of numbers that are no quaternion
        sine, cosine = 2 * (w * z + x * y), w * w + x * x - y * y - z * z
        level = np.hypot(sine, cosine) > LEAST_LEVEL * (w * w + x * x + y * y + z * z)
        return np.where(level, np.arctan2(sine, cosine), np.nan)


def planar_motion(moved: Double, turned: Double, headings: Double, frame: str) -> dict[str, Double]:
    """Velocities by the names that maps have for them, [n] each, in the frame `body` or `world`.

    Velocities `moved` are [n, 2] m/s, turn rates [n] rad/s, both in the world, headings [n] rad.
    """
    if frame != "body":
        return {"vx": moved[:, 0], "vy": moved[:, 1], "omega": turned}
    cosine, sine = np.cos(headings), np.sin(headings)
    ahead = cosine * moved[:, 0] + sine * moved[:, 1]
    return {"v": ahead, "vy": -sine * moved[:, 0] + cosine * moved[:, 1], "omega": turned}


def plain_frame(name: str) -> str:
    """The name of a frame without the slash that ROS 1 once wrote before it."""
    return name.removeprefix("/")


class PlanarFrames:
    """The static transforms of a map and of its bags, of which the first of a frame counts."""

    def __init__(self, world: str, transforms: Iterable[StaticTransform]) -> None:
        self.world = plain_frame(world)
        self._parents: dict[str, StaticTransform] = {}
        for transform in transforms:
            self._parents.setdefault(plain_frame(transform.frame), transform)

    def pose_of(self, frame: str, what: str) -> tuple[float, float, float]:
        """The pose of a frame (empty: the world) in the world: x and y in m, heading in rad."""
        x, y, heading = 0.0, 0.0, 0.0
        passed = [plain_frame(frame)]
        while passed[-1] not in ("", self.world):
            transform = self._parents.get(passed[-1])
            if transform is None or (parent := plain_frame(transform.parent)) in passed:
                raise ConversionError(
                    f"{what} are in the frame {frame!r}, and no static transforms lead from it to "
                    f"{self.world!r} (the way was {' > '.join(passed)}). Add one to `transforms` "
                    f"of the map, or set `world: {frame}` if it is the dataset's frame."
                )
            cosine, sine = np.cos(transform.heading), np.sin(transform.heading)
            x, y = transform.x + cosine * x - sine * y, transform.y + sine * x + cosine * y
            heading += transform.heading
            passed.append(parent)
        return float(x), float(y), float(heading)

    def points(self, samples: Samples, frame: str, what: str) -> Samples:
        """Points [n, 2] of a frame as points of the world; raises as `pose_of` does."""
        x, y, heading = self.pose_of(frame, what)
        if (x, y, heading) == (0.0, 0.0, 0.0):
            return samples
        cosine, sine = np.cos(heading), np.sin(heading)
        turned = samples.values @ np.array([[cosine, sine], [-sine, cosine]])
        return Samples(samples.times, turned + np.array([x, y]))
