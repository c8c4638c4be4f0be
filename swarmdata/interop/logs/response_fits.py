"""How logged robots answer commands: gains, lag and delay of `logged_drives`, by least squares.

They minimize the error of the displacement and the turn that commands predict over `HORIZON`. With
the mean squares of both, the loss of n windows is that of independent Gaussian errors of unknown
variance, up to a constant,

    n log(mean |displacement error|^2) + n / 2 log(mean (turn error)^2)

Displacements are along the measured headings, so both are linear in the gains; lag and delay are
searched. Short windows would not do: the noise of poses, and commands that change between two
steps, make the gains of single steps too small.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from swarmdata.interop.logs.logged_drives import LEAD, Drives, Response, delayed, window_sums
from swarmdata.types import Bool, Double

HORIZON = 2.0  # s, of the predictions that are fitted and judged
LAGS = (0.0, 0.03, 0.06, 0.12, 0.25, 0.5, 1.0)  # s
"""Between which lags are searched, with delays up to `LEAD`."""

LAG_TOLERANCE = 2e-3  # s

LEAST_EXPLAINED = 0.2
"""Least share of the squared displacements and turns that commands explain in a fit."""

LEAST_WINDOWS = 20  # fewest windows, which overlap, of a fit


@dataclass(frozen=True, slots=True)
class Fit:
    """The response of some robots, and how well it explains what they did."""

    response: Response
    loss: float
    speed_explained: float  # share of the squared displacements
    turn_explained: float  # share of the squared turns
    is_edge: bool  # whether lag or delay are the longest that are searched

    @property
    def lacks(self) -> str:
        """Why it cannot be trusted; empty if it can."""
        gains = {"speed_gain": self.speed_explained, "turn_gain": self.turn_explained}
        for name, share in gains.items():
            if share < LEAST_EXPLAINED or getattr(self.response, name) <= 0:
                what = "displacements" if name == "speed_gain" else "turns"
                return (
                    f"commands explain {max(share, 0.0):.0%} of the {what}, expected at least "
                    f"{LEAST_EXPLAINED:.0%}"
                )
        return f"motion comes {LEAD:g} s or more after commands" if self.is_edge else ""


@dataclass(frozen=True, slots=True)
class ErrorSources:
    """What errors of predictions consist of, by how they grow with time."""

    position: float  # m, noise of measured positions, each component
    heading: float  # rad, noise of measured headings
    speed_walk: float  # m, deviation after 1 s of errors that are anew in each step
    turn_walk: float  # rad, likewise
    speed_bias: float  # m/s, errors that last for a prediction, such as those of gains
    turn_bias: float  # rad/s, likewise
    drift: dict[str, float]  # rates of `sensing_models.Drift` that give errors of this size


def fit_response(drives: Drives) -> Fit | None:
    """Fits one response to all robots of some drives; None if there are too few windows."""
    search = Search.of(drives)
    if search is None:
        return None
    rough = [fit for lag in LAGS for fit in search.fits(lag)]
    near = min(rough, key=_loss).response.delay
    fine = [
        search.refine(min((fit for fit in rough if fit.response.delay == delay), key=_loss))
        for delay in range(near - 1, near + 2)  # a longer lag may take the place of a step
        if 0 <= delay <= drives.steps(LEAD)
    ]
    return min(fine, key=_loss)


def gaussian_loss(errors: Double) -> float:
    """The loss of errors of displacements and turns, [n, 3], above what float32 resolves."""
    squares = max(float((errors[:, :2] ** 2).sum(axis=1).mean()), 1e-16)
    turns = max(float((errors[:, 2] ** 2).mean()), 1e-16)
    return len(errors) * (math.log(squares) + 0.5 * math.log(turns))


def _loss(fit: Fit) -> float:
    return fit.loss


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """The windows of drives that responses are fitted to."""

    drives: Drives
    length: int  # steps of a window
    chosen: Bool  # [E, N, S] where windows begin
    measured: Double  # [n, 3] displacement and turn in each window

    @classmethod
    def of(cls, drives: Drives, length: int | None = None) -> "Search | None":
        """All windows, which overlap; None if there are too few."""
        length = length or drives.steps(HORIZON)
        chosen = drives.starts(length)
        if chosen.sum() < LEAST_WINDOWS:
            return None
        return cls(drives, length, chosen, window_sums(drives.measured(), length)[chosen])

    def expected(self, motors: Double, delay: int) -> Double:
        """Displacement and turn in each window at gains of 1, [n, 3]."""
        return window_sums(self.drives.unit_motion(motors, delay), self.length)[self.chosen]

    def fits(self, lag: float, delays: Sequence[int] | None = None) -> Iterator[Fit]:
        """The best gains at a lag and each of some delays; None: of all."""
        motors = self.drives.motors(lag)
        for delay in range(self.drives.steps(LEAD) + 1) if delays is None else delays:
            expected = self.expected(motors, delay)
            speed, speed_explained = _gain(expected[:, :2], self.measured[:, :2])
            turn, turn_explained = _gain(expected[:, 2], self.measured[:, 2])
            loss = gaussian_loss(np.array([speed, speed, turn]) * expected - self.measured)
            is_edge = lag > LAGS[-1] - 2 * LAG_TOLERANCE or delay == self.drives.steps(LEAD)
            response = Response(speed, turn, lag, delay)
            yield Fit(response, loss, speed_explained, turn_explained, is_edge)

    def refine(self, rough: Fit) -> Fit:
        """The best lag between the neighbors of one of `LAGS` at its delay, by golden sections."""
        k, delay = LAGS.index(rough.response.lag), rough.response.delay
        low, high = LAGS[max(k - 1, 0)], LAGS[min(k + 1, len(LAGS) - 1)]
        golden = (math.sqrt(5) - 1) / 2
        left, right = high - golden * (high - low), low + golden * (high - low)
        tried = {lag: next(self.fits(lag, [delay])) for lag in (left, right)}
        while high - low > LAG_TOLERANCE:
            if tried[left].loss < tried[right].loss:
                high, right = right, left
                left = new = high - golden * (high - low)
            else:
                low, left = left, right
                right = new = low + golden * (high - low)
            tried[new] = next(self.fits(new, [delay]))
        return min([rough, *tried.values()], key=_loss)

    def errors(self, response: Response) -> Double:
        """Errors of the displacement and the turn of each window, [n, 3]."""
        gains = np.array([response.speed_gain, response.speed_gain, response.turn_gain])
        motors = self.drives.motors(response.lag)
        return gains * self.expected(motors, response.delay) - self.measured


def _gain(expected: Double, measured: Double) -> tuple[float, float]:
    """The gain of least squares, and the share of the measured squares that it explains."""
    power, total = float((expected**2).sum()), float((measured**2).sum())
    gain = float((expected * measured).sum()) / power if power > 0 else 0.0
    return gain, gain * gain * power / total if total > 0 else 0.0


def error_sources(drives: Drives, responses: Sequence[Response]) -> ErrorSources:
    """Splits squared errors over windows of several lengths t: noise + walk t + bias t^2."""
    longest = drives.steps(HORIZON)
    lengths = sorted({1, 2, *(max(1, longest * k // 8) for k in range(1, 9))})
    times = drives.dt * np.array(lengths)
    squares = np.array([np.mean(_residuals(drives, responses, n)[0] ** 2, axis=0) for n in lengths])
    terms = np.stack([np.full_like(times, 2.0), times, times**2], axis=1)
    found = []
    for column in (squares[:, :2].mean(axis=1), squares[:, 2]):
        scale = 1 / np.maximum(column, 1e-16)
        found.append(np.sqrt(_nonnegative(terms * scale[:, None], column * scale)))
    (position, speed_walk, speed_bias), (heading, turn_walk, turn_bias) = np.array(found).tolist()
    errors, paths = _residuals(drives, responses, longest)
    driven, turned = paths.T
    growth = np.stack([driven**2 + driven, turned**2 + turned], axis=1)
    rates = np.sqrt(_nonnegative(growth, errors[:, 2] ** 2)).tolist()
    moved = float((driven**2 + 2 * driven).mean())
    drift = {
        "position": math.sqrt(float((errors[:, :2] ** 2).sum(axis=1).mean()) / moved),
        "heading": rates[0],
        "turning": rates[1],
    }
    return ErrorSources(
        position, heading, speed_walk, turn_walk, speed_bias, turn_bias,
        {name: round(rate, 4) for name, rate in drift.items()},
    )  # fmt: skip


def _residuals(drives: Drives, responses: Sequence[Response], length: int) -> tuple[Double, Double]:
    """Errors of displacements and turns over windows, [n, 3], and the paths, [n, 2] m, rad."""
    errors, paths = [], []
    for n, response in enumerate(responses):
        alone = drives.part(robots=[n])
        search = Search.of(alone, length)
        if search is None:
            continue
        errors.append(search.errors(response))
        speeds = np.abs(delayed(alone.motors(response.lag), response.delay)) * drives.dt
        gains = np.array([response.speed_gain, response.turn_gain])
        paths.append(gains * window_sums(speeds, length)[search.chosen])
    return np.concatenate(errors), np.concatenate(paths)


def _nonnegative(columns: Double, target: Double) -> Double:
    """Least squares whose coefficients are at least 0: the best of all sets of columns, [k]."""
    k = columns.shape[1]
    best, least = np.zeros(k), math.inf
    for size in range(1, k + 1):
        for chosen in combinations(range(k), size):
            some = list(chosen)
            found = np.linalg.lstsq(columns[:, some], target, rcond=None)[0]
            rest = float(((columns[:, some] @ found - target) ** 2).sum())
            if rest < least and (found >= 0).all():
                best, least = np.zeros(k), rest
                best[some] = found
    return best
