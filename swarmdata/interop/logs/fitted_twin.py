"""A twin of logged robots: a task whose unicycles answer commands as the logs show.

Gains, lag and delay (`logged_drives`) minimize the error of the displacement and the turn that
commands predict over `HORIZON`. With the mean squares of both, the loss of n windows is that of
independent Gaussian errors of unknown variance, up to a constant,

    n log(mean |displacement error|^2) + n / 2 log(mean (turn error)^2)

Displacements are along the measured headings, so both are linear in the gains, which least squares
give; lag and delay are searched. Short windows would not do: noise of poses and commands that come
between two steps make gains of single steps too small.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.logs.logged_drives import (
    AS_COMMANDED,
    LEAD,
    STANDING,
    Drives,
    Response,
    delayed,
    window_sums,
)
from swarmdata.rollouts.score_intervals import (
    AT_LEAST_ZERO,
    SHARE,
    difference_interval,
    mean_interval,
)
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.task_spec import Robot, TaskSpec
from swarmdata.types import Bool, Double

HORIZON = 2.0  # s, of the predictions that are fitted and judged

LAGS = (0.0, 0.03, 0.06, 0.12, 0.25, 0.5, 1.0)  # s
"""Between which lags are searched, with delays up to `LEAD`."""

LAG_TOLERANCE = 2e-3  # s

LEAST_EXPLAINED = 0.2
"""Least share of the squared displacements and turns that commands explain in a fit."""

LEAST_WINDOWS = 20
"""Fewest windows, which overlap, of a fit."""

N_PARTS = 4
"""Parts of the training split whose fits give the ranges of the randomization."""

CLOSE = (0.1, math.radians(10.0))  # m, rad: what counts as a good prediction


@dataclass(frozen=True, slots=True)
class Fit:
    """The response of some robots, and how well it explains what they did."""

    response: Response
    loss: float
    speed_explained: float  # share of the squared displacements
    turn_explained: float  # share of the squared turns

    @property
    def lacks(self) -> str:
        """Why it cannot be trusted; empty if it can."""
        gains = {"speed_gain": self.speed_explained, "turn_gain": self.turn_explained}
        for name, share in gains.items():
            if share < LEAST_EXPLAINED or getattr(self.response, name) <= 0:
                what = "displacements" if name == "speed_gain" else "turns"
                return f"commands explain {max(share, 0.0):.0%} of the {what}"
        if self.response.lag > 0.99 * LAGS[-1]:
            return f"the lag is longer than {LAGS[-1]:g} s, the end of the search"
        return ""


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


@dataclass(frozen=True, slots=True, eq=False)
class Predictions:
    """Errors of open-loop predictions after `HORIZON`, means of each episode."""

    distances: Double  # [E] m
    angles: Double  # [E] degrees
    close: Double  # [E] share within 10 cm and 10 degrees
    n: int  # predictions

    @property
    def estimates(self) -> tuple[Estimate, Estimate, Estimate]:
        """Distance, angle and share, with intervals over episodes."""
        return (
            mean_interval(self.distances[None], bounds=AT_LEAST_ZERO),
            mean_interval(self.angles[None], bounds=AT_LEAST_ZERO),
            mean_interval(self.close[None], bounds=SHARE),
        )

    def less(self, other: "Predictions") -> tuple[Estimate, Estimate]:
        """Distance and angle minus those of another predictor on the same episodes."""
        return (
            difference_interval(self.distances[None], other.distances[None]),
            difference_interval(self.angles[None], other.angles[None]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Twin:
    """A fitted twin of logged robots.

    Attributes:
        spec: unicycles, as many as the logged robots; `swarmdata.make_env` runs it. Its action of 1
            is the largest command that the logs allow.
        responses: of each robot, by name.
        team: of all robots together.
        sources: of the errors that remain.
        source: id and digest of the dataset that it was fitted to.
        largest: commands that are actions of 1, m/s and rad/s.
        flags: robots whose own response is not determined, and why; they have the team's.
    """

    spec: TaskSpec
    responses: dict[str, Response]
    team: Fit
    sources: ErrorSources
    source: str
    largest: tuple[float, float]
    flags: dict[str, str] = field(default_factory=dict)

    def check(self, *datasets: Dataset) -> dict[str, Predictions]:
        """Predicts drives that the twin was not fitted to, under their logged commands.

        Returns:
            of the twin, of commands taken as they are, and of robots that stand still.

        Raises:
            ConversionError: a dataset is of other robots or steps, or too short.
        """
        n = len(self.responses)
        predictors = {
            "twin": list(self.responses.values()),
            "commands as they are": [AS_COMMANDED] * n,
            "no motion": [STANDING] * n,
        }
        checked = [self._drives(each) for each in datasets]
        return {name: _judged(checked, each) for name, each in predictors.items()}

    def to_yaml(self) -> str:
        """The spec, and what it was fitted to as a comment."""
        speed, turn = self.largest
        return (
            f"# A twin of the robots of {self.source}: an action of 1 is a command of {speed:g} m/s "
            f"or {turn:g} rad/s.\n{self.spec.to_yaml()}"
        )

    def _drives(self, dataset: Dataset) -> Drives:
        drives = Drives.of(dataset)
        if drives.names != tuple(self.responses) or drives.dt != self.spec.control_dt:
            raise ConversionError(
                f"{dataset.recipe.id} has the robots {', '.join(drives.names)} in steps of "
                f"{drives.dt:g} s, expected {', '.join(self.responses)} in steps of "
                f"{self.spec.control_dt:g} s, as the twin has"
            )
        if not drives.starts(drives.steps(HORIZON)).any():
            raise ConversionError(
                f"{dataset.recipe.id} has no stretch of {LEAD + HORIZON:g} s in which a robot's "
                "pose and command are known, to check the twin with"
            )
        return drives


def fit_twin(dataset: Dataset, *, radius: float | None = None, drift: bool = False) -> Twin:
    """Fits a twin to the training split of a dataset that was imported from logs of robots.

    Each robot has its own response if that predicts one half of the training split better from the
    other, else all have the team's. Ranges of the randomization are those that robots and quarters
    of the split give.

    Args:
        dataset: with poses, and commands of speed and turn rate.
        radius: of the robots, m, which logs do not tell; None: that of other specs.
        drift: whether robots of the twin know their pose by odometry, which drifts as predictions
            by commands do; otherwise they know it with the noise of the logged poses.

    Raises:
        ConversionError: it has no such commands, is too short, or commands do not explain what the
            robots did.
        SpecError: a robot of this kind is no valid spec.
    """
    training = dataset.filter(split="train")
    drives = Drives.of(training)
    every = range(len(drives.names))
    fits = {n: fit_response(drives.part(robots=[n])) for n in every}
    flags = {n: "too few steps without gaps" if fit is None else fit.lacks
             for n, fit in fits.items()}  # fmt: skip
    sound = [n for n in every if not flags[n]]
    team = fit_response(drives.part(robots=sound)) if sound else fit_response(drives)
    if team is None:
        raise ConversionError(
            f"{dataset.recipe.id} has fewer than {LEAST_WINDOWS} stretches of "
            f"{LEAD + HORIZON:g} s in its training split in which a robot's pose and command are "
            "known. Log longer drives, or raise `max_gap` of the map"
        )
    if not sound or team.lacks:
        raise ConversionError(
            f"{dataset.recipe.id} does not determine how its robots answer commands: "
            f"{team.lacks or next(iter(flags.values()))}, expected at least "
            f"{LEAST_EXPLAINED:.0%}. Log drives with turns and stops, and check `clock_offset` "
            "and the units of the map"
        )
    own = _predicts_better(drives, sound)
    responses = [
        fits[n].response if own and n in sound else team.response  # type: ignore[union-attr]
        for n in every
    ]
    sources = _error_sources(drives.part(robots=sound), [responses[n] for n in sound])
    spec = _spec(drives, responses, sources, _part_fits(drives, sound), radius, dataset, drift)
    return Twin(
        spec=spec,
        responses=dict(zip(drives.names, responses, strict=True)),
        team=team,
        sources=sources,
        source=f"{dataset.recipe.id} (digest {dataset.digest[:12]})",
        largest=drives.largest,
        flags={drives.names[n]: flag for n, flag in flags.items() if flag},
    )


def fit_response(drives: Drives) -> Fit | None:
    """Fits one response to all robots of some drives; None if there are too few windows."""
    search = _Search.of(drives)
    if search is None:
        return None
    rough = min((fit for lag in LAGS for fit in search.fits(lag)), key=lambda fit: fit.loss)
    k = LAGS.index(rough.response.lag)
    fine = search.refine(LAGS[max(k - 1, 0)], LAGS[min(k + 1, len(LAGS) - 1)], rough.response.delay)
    return min(rough, fine, key=lambda fit: fit.loss)


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """The windows of drives that responses are fitted to."""

    drives: Drives
    length: int  # steps of a window
    chosen: Bool  # [E, N, S] where windows begin
    measured: Double  # [n, 3] displacement and turn in each window

    @classmethod
    def of(cls, drives: Drives, length: int | None = None) -> "_Search | None":
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
            yield self._fit(self.expected(motors, delay), lag, delay)

    def refine(self, low: float, high: float, delay: int) -> Fit:
        """The best lag of an interval at a delay, by golden sections."""
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
        return min(tried.values(), key=lambda fit: fit.loss)

    def _fit(self, expected: Double, lag: float, delay: int) -> Fit:
        gains, means, explained = [], [], []
        for columns in (slice(0, 2), slice(2, 3)):
            x, y = expected[:, columns], self.measured[:, columns]
            power, total = float((x * x).sum()), float((y * y).sum())
            gain = float((x * y).sum()) / power if power > 0 else 0.0
            rest = float(((y - gain * x) ** 2).sum())
            gains.append(gain)
            means.append(max(rest / len(x), 1e-16))  # below what float32 poses resolve
            explained.append(1.0 - rest / total if total > 0 else 0.0)
        loss = len(expected) * (math.log(means[0]) + 0.5 * math.log(means[1]))
        return Fit(Response(*gains, lag, delay), loss, *explained)

    def loss(self, response: Response) -> float:
        """The loss of a response that was fitted to other windows."""
        errors = self.errors(response)
        squares = max(float((errors[:, :2] ** 2).sum(axis=1).mean()), 1e-16)
        turns = max(float((errors[:, 2] ** 2).mean()), 1e-16)
        return len(errors) * (math.log(squares) + 0.5 * math.log(turns))

    def errors(self, response: Response) -> Double:
        """Errors of the displacement and the turn of each window, [n, 3]."""
        gains = np.array([response.speed_gain, response.speed_gain, response.turn_gain])
        motors = self.drives.motors(response.lag)
        return gains * self.expected(motors, response.delay) - self.measured


def _predicts_better(drives: Drives, robots: Sequence[int]) -> bool:
    """Whether robots' own responses predict one half of the episodes better, from the other."""
    gain = 0.0
    for half in (0, 1):
        fitted, judged = slice(half, None, 2), slice(1 - half, None, 2)
        team = fit_response(drives.part(fitted, robots))
        for n in robots:
            own = fit_response(drives.part(fitted, [n]))
            search = _Search.of(drives.part(judged, [n]))
            if team is None or own is None or search is None:
                return False
            gain += search.loss(team.response) - search.loss(own.response)
    return gain > 0


def _part_fits(drives: Drives, robots: Sequence[int]) -> list[Response]:
    """Responses of each robot in each part of the episodes, where they are determined."""
    found = []
    for part in np.array_split(np.arange(len(drives.known)), N_PARTS):
        for n in robots:
            fit = (
                fit_response(drives.part(slice(part[0], part[-1] + 1), [n])) if len(part) else None
            )
            if fit is not None and not fit.lacks:
                found.append(fit.response)
    return found


def _error_sources(drives: Drives, responses: Sequence[Response]) -> ErrorSources:
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
    """Errors of displacements and turns over windows, [n, 3]; what they drove and turned, [n, 2]."""
    errors, paths = [], []
    for n, response in enumerate(responses):
        alone = drives.part(robots=[n])
        search = _Search.of(alone, length)
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


def _spec(
    drives: Drives,
    responses: Sequence[Response],
    sources: ErrorSources,
    parts: Sequence[Response],
    radius: float | None,
    dataset: Dataset,
    drift: bool,
) -> TaskSpec:
    """The twin's task: `coop_nav` without obstacles, in an arena as large as that of the logs."""
    size = Robot().radius if radius is None else radius
    placed = drives.poses[:, :, :-1, :2][drives.known]
    width, height = (np.ptp(placed, axis=0) + 2 * size).round(2).tolist()
    robots = [_robot(drives, each, size) for each in responses]
    if all(each == robots[0] for each in robots):
        team = [{"count": len(robots), "robot": robots[0]}]
    else:
        team = [{"name": name, "count": 1, "robot": robot}
                for name, robot in zip(drives.names, robots, strict=True)]  # fmt: skip
    noise = {"position": round(sources.position, 4), "direction": round(sources.heading, 4)}
    content = {
        "rules": {"task": "coop_nav"},
        "team": team,
        "arena": {"width": width, "height": height},
        "obstacles": {"circles": 0, "boxes": 0, "corners": 0, "pockets": 0},
        "spawn": {"min_goal_distance": min(1.2, round(min(width, height) / 2, 2))},
        "horizon": dataset.spec.horizon or drives.known.shape[2],
        "control_dt": drives.dt,
        "physics_dt": drives.dt / 2,
        "observation": {
            "kind": "state",
            **({"drift": sources.drift} if drift else {"noise": noise}),
        },
        "randomization": _ranges(drives, [*parts, *responses]),
    }
    return TaskSpec.parse(content, f"the twin of {dataset.recipe.id}")


def _robot(drives: Drives, response: Response, radius: float) -> dict[str, object]:
    """A unicycle whose motors are strong enough to do in a physics step what a command asks for."""
    speed = round(response.speed_gain * drives.largest[0], 4)
    return {
        "radius": radius,
        "dynamics": "unicycle",
        "max_speed": speed,
        "max_acceleration": round(4 * speed / drives.dt, 4),
        "max_turn_rate": round(response.turn_gain * drives.largest[1], 4),
        "command_delay": response.delay,
        "actuator_lag": round(response.lag, 4),
    }


def _ranges(drives: Drives, found: Sequence[Response]) -> dict[str, tuple[float, float]]:
    """The least and the greatest of what robots and parts of the logs gave."""
    values = {
        "max_speed": [round(each.speed_gain * drives.largest[0], 4) for each in found],
        "max_turn_rate": [round(each.turn_gain * drives.largest[1], 4) for each in found],
        "actuator_lag": [round(each.lag, 4) for each in found],
        "command_delay": [each.delay for each in found],
    }
    return {name: (min(each), max(each)) for name, each in values.items() if min(each) < max(each)}


def _judged(checked: Sequence[Drives], responses: Sequence[Response]) -> Predictions:
    """Means over each episode of the errors after `HORIZON`."""
    rows, n = [], 0
    for drives in checked:
        distances, angles, episodes = drives.errors_of(responses, drives.steps(HORIZON))
        close = (distances <= CLOSE[0]) & (angles <= CLOSE[1])
        values = np.stack([distances, np.rad2deg(angles), close])
        rows += [values[:, episodes == k].mean(axis=1) for k in np.unique(episodes)]
        n += len(distances)
    return Predictions(*np.stack(rows, axis=1), n)


def describe(twin: Twin, checked: Mapping[str, Predictions]) -> str:
    """What was fitted, and how well it predicts, as lines of text."""
    line = "{:22} {:>10} {:>9} {:>7} {:>13}"
    lines = [f"fitted to the training split of {twin.source}"]
    lines.append(line.format("robots", "speed gain", "turn gain", "lag (s)", "delay (steps)"))
    alike = len({*twin.responses.values()}) == 1
    for name, each in {"all": twin.team.response, **({} if alike else twin.responses)}.items():
        gains = f"{each.speed_gain:.3f}", f"{each.turn_gain:.3f}", f"{each.lag:.3f}"
        lines.append(line.format(name, *gains, each.delay))
    lines += [f"{name} has the response of all: {why}" for name, why in twin.flags.items()]
    of = twin.sources
    lines.append(
        f"noise of poses {100 * of.position:.2f} cm, {math.degrees(of.heading):.2f} degrees; errors "
        f"of each step add up to {100 * of.speed_walk:.2f} cm, {math.degrees(of.turn_walk):.2f} "
        f"degrees in a second, lasting ones to {100 * of.speed_bias:.2f} cm, "
        f"{math.degrees(of.turn_bias):.2f} degrees"
    )
    lines.append("odometry by commands: " + ", ".join(f"{k} {v:g}" for k, v in of.drift.items()))
    if not checked:
        return "\n".join([*lines, "no held-out episodes to check it with"])
    first = next(iter(checked.values()))
    lines.append(
        f"errors after {HORIZON:g} s, {first.n:,} predictions in {len(first.distances)} held-out "
        "episodes, with 95 % intervals over episodes"
    )
    line = "{:22} {:>22} {:>22} {:>22}"
    lines.append(line.format("", "position (cm)", "heading (degrees)", "within 10 of both (%)"))
    for name, each in checked.items():
        cells = map(_cell, each.estimates, (100.0, 1.0, 100.0))
        lines.append(line.format(name, *cells))
    return "\n".join(lines)


def _cell(found: Estimate, factor: float) -> str:
    """An estimate with its interval, which a single episode does not give."""
    text = f"{factor * found.value:.2f}"
    low, high = factor * found.low, factor * found.high
    return text if math.isnan(low) else f"{text} [{low:.2f}, {high:.2f}]"
