"""Entropy and mutual information of samples, from distances to neighbors in the maximum norm.

Samples are finite and without copies or constant coordinates, as `dither` makes them.
"""

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.numerics.random import derive, uniform
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Double, Int

NEIGHBOR_RANK = 4
"""Rank of the nearest neighbor that is used. Kraskov et al. 2004 (section III.A) recommend 2 to 4:
a lower rank increases the variance, a higher one the bias."""

EULER_GAMMA = 0.5772156649015329


@kernel
def _gap(points: Double, i: int, j: int, limit: float) -> float:
    """Distance of two points if it is below the limit, else some value at or above the limit."""
    gap = 0.0
    for c in range(points.shape[1]):
        gap = max(gap, abs(points[i, c] - points[j, c]))
        if gap >= limit:
            break
    return gap


@kernel
def _sorted_kth_distances(points: Double, k: int) -> Double:
    """Distance of each point, sorted by the first coordinate, to its k-th neighbor, [n]."""
    n = len(points)
    nearest = np.empty(k)
    distances = np.empty(n)
    for i in range(n):
        nearest[:] = np.inf
        below, above = i - 1, i + 1
        while True:
            down = points[i, 0] - points[below, 0] if below >= 0 else np.inf
            up = points[above, 0] - points[i, 0] if above < n else np.inf
            if min(down, up) >= nearest[k - 1]:
                break
            j = below if down <= up else above
            below, above = below - (down <= up), above + (down > up)
            gap = _gap(points, i, j, nearest[k - 1])
            if gap < nearest[k - 1]:
                place = k - 1
                while place > 0 and nearest[place - 1] > gap:
                    nearest[place] = nearest[place - 1]
                    place -= 1
                nearest[place] = gap
        distances[i] = nearest[k - 1]
    return distances


@kernel
def _sorted_counts(points: Double, distances: Double) -> Int:
    """Number of others strictly closer to each point, sorted likewise, than its distance, [n]."""
    n = len(points)
    counts = np.zeros(n, np.int64)
    for i in range(n):
        for step in (-1, 1):
            j = i + step
            while 0 <= j < n and abs(points[j, 0] - points[i, 0]) < distances[i]:
                counts[i] += _gap(points, i, j, distances[i]) < distances[i]
                j += step
    return counts


def _neighbor_distances(points: Double) -> Double:
    order = np.argsort(points[:, 0], kind="stable")
    distances = np.empty(len(points))
    distances[order] = _sorted_kth_distances(points[order], NEIGHBOR_RANK)
    return distances


def _count_within(points: Double, distances: Double) -> Int:
    order = np.argsort(points[:, 0], kind="stable")
    counts = np.empty(len(points), np.int64)
    counts[order] = _sorted_counts(points[order], distances[order])
    return counts


def knn_entropy(points: Double, bounds: tuple[float, float] | None = None) -> float:
    """Estimates the differential entropy of the distribution that points were drawn from, nats.

    The Kozachenko-Leonenko estimator as Kraskov, Stoegbauer and Grassberger write it ("Estimating
    mutual information", Physical Review E 69:066138, 2004, equation 20), with the maximum norm, in
    which the unit ball has log-volume 0:

        H = -psi(k) + psi(n) + d / n * sum over i of log(epsilon_i)

    where epsilon_i is twice the distance from point i to its k-th neighbor, k = 4. Every coordinate
    is divided by its standard deviation first, and the logarithms of the deviations are added back,
    so that the choice of units does not decide which points are neighbors.

    In many dimensions, the cubes of side epsilon_i extend far beyond the range of the points, and
    the estimate is too high. With `bounds`, only the part of each cube within them counts:
    d log(epsilon_i) becomes the sum of the logarithms of the clipped sides.

    Args:
        points: independent draws, [n, d] with n > k + 1.
        bounds: smallest and largest possible value of every coordinate, if known.

    Raises:
        SchemaError: a value is out of bounds.
    """
    scales = points.std(axis=0)
    low, high = (-np.inf, np.inf) if bounds is None else bounds
    if points.min() < low or points.max() > high:
        raise SchemaError(
            f"points reach from {points.min():g} to {points.max():g}, expected values from {low:g} "
            f"to {high:g}."
        )
    psi, distances = digamma(len(points)), _neighbor_distances(_standardized(points))
    reach = distances[:, None] * scales  # half the sides, in the points' units
    sides = np.minimum(points + reach, high) - np.maximum(points - reach, low)
    return float(psi[len(points)] - psi[NEIGHBOR_RANK] + np.log(sides).sum(axis=1).mean())


def mutual_information(x: Double, y: Double) -> float:
    """Estimates the mutual information of joint draws x and y, nats; without any, it is about 0.

    The first estimator of Kraskov, Stoegbauer and Grassberger 2004, equation 8:

        I = psi(k) - mean of (psi(n_x + 1) + psi(n_y + 1)) + psi(n)

    where n_x and n_y count the points that are strictly closer in x, and in y, than the k-th
    neighbor in (x, y), k = 4. Every coordinate is divided by its standard deviation first, which
    changes no mutual information. x is [n, d_x], y is [n, d_y], dithered with different seeds.
    """
    a, b = _standardized(x), _standardized(y)
    distances = _neighbor_distances(np.concatenate([a, b], axis=1))
    psi = digamma(len(x))
    marginal = psi[_count_within(a, distances) + 1] + psi[_count_within(b, distances) + 1]
    return float(psi[NEIGHBOR_RANK] + psi[len(x)] - marginal.mean())


def correlation(x: Double, y: Double) -> float:
    """Returns the mean over columns of the absolute Pearson correlation of x with y, [n, d] each.

    A constant column has no correlation and counts as 0. Nonlinear dependence, and dependence
    between different columns, is not measured.
    """
    a, b = x - x.mean(axis=0), y - y.mean(axis=0)
    scale = np.sqrt((a * a).sum(axis=0) * (b * b).sum(axis=0))
    products = np.abs((a * b).sum(axis=0))
    return float(np.where(scale > 0.0, products / np.where(scale > 0.0, scale, 1.0), 0.0).mean())


def dither(points: Double, resolution: float, seed: int) -> Double:
    """Adds uniform noise of width `resolution` to every value; the shape stays.

    Recorded values repeat: robots rest, commands are clipped. Such a distribution has no density,
    and its entropy is minus infinity; that of dithered values is at least log(resolution) for each
    coordinate. Independent noise cannot increase mutual information.
    """
    noise = uniform(derive(seed, np.arange(points.size))).reshape(points.shape) - 0.5
    return points + resolution * noise


def digamma(n: int) -> Double:
    """Returns digamma of 0 (NaN), 1, ..., n, by psi(m + 1) = psi(m) + 1 / m, [n + 1]."""
    steps = np.concatenate([[np.nan, -EULER_GAMMA], 1.0 / np.arange(1, n)])
    steps[1:] = np.cumsum(steps[1:])
    return steps


def _standardized(points: Double) -> Double:
    """Points at mean 0 and unit deviation in each coordinate, [n, d]."""
    centered = (points - points.mean(axis=0)) / points.std(axis=0)
    return np.ascontiguousarray(centered, dtype=np.float64)
