"""A twin of logged robots: a task whose unicycles answer commands as the logs show."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.logs.logged_drives import AS_COMMANDED, LEAD, STANDING, Drives, Response
from swarmdata.interop.logs.response_fits import (
    HORIZON,
    LEAST_WINDOWS,
    ErrorSources,
    Fit,
    Search,
    error_sources,
    fit_response,
    gaussian_loss,
)
from swarmdata.rollouts.score_intervals import (
    AT_LEAST_ZERO,
    SHARE,
    difference_interval,
    mean_interval,
)
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.specs.task_spec import Robot, TaskSpec
from swarmdata.types import Double

N_PARTS = 4  # parts of the training split whose fits give the ranges of the randomization
CLOSE = (0.1, math.radians(10.0))  # m, rad: what counts as a good prediction


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
        away, turned = (
            mean_interval(each[None], bounds=AT_LEAST_ZERO)
            for each in (self.distances, self.angles)
        )
        return away, turned, mean_interval(self.close[None], bounds=SHARE)

    def less(self, other: "Predictions") -> tuple[Estimate, Estimate]:
        """Distance and angle minus those of another predictor on the same episodes."""
        return (
            difference_interval(self.distances[None], other.distances[None]),
            difference_interval(self.angles[None], other.angles[None]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Twin:
    """A fitted twin of logged robots."""

    spec: TaskSpec
    """Unicycles, as many as the logged robots; `swarmdata.make_env` runs it. Its action of 1 is the
    largest command that the logs allow."""
    responses: dict[str, Response]  # of each robot, by name
    team: Fit  # of all robots together
    sources: ErrorSources  # of the errors that remain
    source: str  # id and digest of the dataset that it was fitted to
    largest: tuple[float, float]  # commands that are actions of 1, m/s and rad/s
    flags: dict[str, str] = field(default_factory=dict)
    """Robots whose own response is not determined, and why; they have the team's."""

    def check(self, *datasets: Dataset) -> dict[str, Predictions]:
        """Predicts drives that the twin was not fitted to, under their logged commands.

        Returns:
            of the twin, of commands taken as they are, and of robots that stand still.

        Raises:
            ConversionError: a dataset is of other robots or steps, or all are too short.
        """
        n = len(self.responses)
        predictors = {
            "twin": list(self.responses.values()),
            "commands as they are": [AS_COMMANDED] * n,
            "no motion": [STANDING] * n,
        }
        checked = [self._drives(each) for each in datasets]
        if not any(each.starts(each.steps(HORIZON)).any() for each in checked):
            raise ConversionError(
                f"{', '.join(each.recipe.id for each in datasets)} has no stretch of "
                f"{LEAD + HORIZON:g} s in which a robot's pose and command are known, to check the "
                "twin with"
            )
        return {name: _judged(checked, each) for name, each in predictors.items()}

    def to_yaml(self) -> str:
        """The spec, and what it was fitted to as a comment."""
        speed, turn = self.largest
        return (
            f"# A twin of the robots of {self.source}: an action of 1 is a command of\n"
            f"# {speed:g} m/s or {turn:g} rad/s.\n{self.spec.to_yaml()}"
        )

    def _drives(self, dataset: Dataset) -> Drives:
        drives = Drives.of(dataset)
        if drives.names != tuple(self.responses) or drives.dt != self.spec.control_dt:
            raise ConversionError(
                f"{dataset.recipe.id} has the robots {', '.join(drives.names)} in steps of "
                f"{drives.dt:g} s, expected {', '.join(self.responses)} in steps of "
                f"{self.spec.control_dt:g} s, as the twin has"
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
    fits = [fit_response(drives.part(robots=[n])) for n in range(len(drives.names))]
    flags = ["too few steps without gaps" if fit is None else fit.lacks for fit in fits]
    sound = {n: fit.response for n, fit in enumerate(fits) if fit is not None and not fit.lacks}
    team = fit_response(drives.part(robots=[*sound]) if sound else drives)
    if team is None:
        raise ConversionError(
            f"{dataset.recipe.id} has fewer than {LEAST_WINDOWS} stretches of "
            f"{LEAD + HORIZON:g} s in its training split in which a robot's pose and command are "
            "known. Log longer drives, or raise `max_gap` of the map"
        )
    if not sound or team.lacks:
        raise ConversionError(
            f"{dataset.recipe.id} does not determine how its robots answer commands: "
            f"{team.lacks or '; '.join(sorted({*flags}))}. Log drives with turns and "
            "stops, and check `clock_offset` and the units of the map"
        )
    own = sound if _predicts_better(drives, [*sound]) else {}
    responses = [own.get(n, team.response) for n in range(len(fits))]
    sources = error_sources(drives.part(robots=[*sound]), [responses[n] for n in sound])
    spec = _spec(drives, responses, sources, _part_fits(drives, [*sound]), radius, dataset, drift)
    return Twin(
        spec=spec,
        responses=dict(zip(drives.names, responses, strict=True)),
        team=team,
        sources=sources,
        source=f"{dataset.recipe.id} (digest {dataset.digest[:12]})",
        largest=drives.largest,
        flags={name: flag for name, flag in zip(drives.names, flags, strict=True) if flag},
    )


def _predicts_better(drives: Drives, robots: Sequence[int]) -> bool:
    """Whether robots' own responses predict one half of the episodes better, from the other."""
    gain = 0.0
    for half in (0, 1):
        fitted, judged = slice(half, None, 2), slice(1 - half, None, 2)
        team = fit_response(drives.part(fitted, robots))
        for n in robots:
            own = fit_response(drives.part(fitted, [n]))
            search = Search.of(drives.part(judged, [n]))
            if team is None or own is None or search is None:
                return False
            gain += gaussian_loss(search.errors(team.response))
            gain -= gaussian_loss(search.errors(own.response))
    return gain > 0


def _part_fits(drives: Drives, robots: Sequence[int]) -> list[Response]:
    """Responses of each robot in each part of the episodes, where they are determined."""
    parts = np.array_split(np.arange(len(drives.known)), N_PARTS)
    slices = [slice(part[0], part[-1] + 1) for part in parts if len(part)]
    fits = [fit_response(drives.part(part, [n])) for part in slices for n in robots]
    return [fit.response for fit in fits if fit is not None and not fit.lacks]


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
    slowest = min(each.speed_gain for each in responses) * drives.largest[0]
    noise = {"position": round(sources.position, 4), "direction": round(sources.heading, 4)}
    content = {
        "rules": {"task": "coop_nav"},
        "team": team,
        "arena": {"width": width, "height": height},
        "obstacles": {"circles": 0, "boxes": 0, "corners": 0, "pockets": 0},
        "spawn": {"min_goal_distance": min(1.2, round(min(width, height) / 2, 2))},
        # in which the slowest robot can cross the arena, and half as far again
        "horizon": math.ceil(1.5 * math.hypot(width, height) / slowest / drives.dt),
        "control_dt": drives.dt,
        "physics_dt": drives.dt / 2,
        "observation": {"kind": "state"}
        | ({"drift": sources.drift} if drift else {"noise": noise}),
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
    values: dict[str, list[float]] = {
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
    means = np.stack(rows)
    return Predictions(means[:, 0], means[:, 1], means[:, 2], n)


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
        f"noise of poses {100 * of.position:.2f} cm, {math.degrees(of.heading):.2f} degrees; in a "
        f"second, errors of steps add up to {100 * of.speed_walk:.2f} cm, "
        f"{math.degrees(of.turn_walk):.2f} degrees, lasting ones to {100 * of.speed_bias:.2f} cm, "
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
    for name, found in checked.items():
        cells = map(_cell, found.estimates, (100.0, 1.0, 100.0))
        lines.append(line.format(name, *cells))
    closer, straighter = checked["twin"].less(checked["commands as they are"])
    lines.append(
        f"of the twin minus those of commands: {_cell(closer, 100)} cm, "
        f"{_cell(straighter, 1)} degrees"
    )
    return "\n".join(lines)


def _cell(found: Estimate, factor: float) -> str:
    """An estimate with its interval, which a single episode does not give."""
    text = f"{factor * found.value:.2f}"
    low, high = factor * found.low, factor * found.high
    return text if math.isnan(low) else f"{text} [{low:.2f}, {high:.2f}]"
