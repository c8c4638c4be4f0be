"""How observations are worsened, whatever the model: noise, lost returns, delay and stacking.

A *return* is what one echo gives: a slot or a beam. The names of the features tell: the features
`beam_3.distance`, `beam_3.robot`, ... belong to one return because they share a numbered prefix and
have a flag that says whether anything is there. So a model gets dropout by naming its features.

Noise and losses are functions of the episode's seed and the step in which a frame is sensed.
"""

import itertools
import re
from collections.abc import Sequence

import numpy as np

from swarmdata.compiling import kernel
from swarmdata.counters import absorb, to_normal, to_uniform
from swarmdata.features import Feature
from swarmdata.seeding import STREAMS, normal_table
from swarmdata.senses import ObservationModel, SensorNoise
from swarmdata.types import Bool, Double, Float, Int, Seeds, Step

_STREAM = STREAMS["sensor"]
_NOISE, _LOSS = 0, 1
"""Last counter but one of each draw; the last one is the feature, or the return."""

_PLAIN, _FLAG, _DISTANCE = 0, 1, 2


def returns_of(features: Sequence[Feature]) -> Int:
    """First feature of each return, and one past its last, [R, 2]."""
    found, first = [], 0
    for prefix, run in itertools.groupby(features, _numbered_prefix):
        group = list(run)
        if prefix and any(feature.kind == "flag" for feature in group):
            found.append((first, first + len(group)))
        first += len(group)
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def lost_values(features: Sequence[Feature]) -> Float:
    """What each feature of a lost return reads, [F].

    0, except a distance with no mask beside it: its 1 says that nothing is within range.
    """
    values = np.zeros(len(features), dtype=np.float32)
    for first, last in returns_of(features):
        group = features[first:last]
        if not any(feature.name.endswith(".mask") for feature in group):
            values[first:last] = [feature.kind == "range" for feature in group]
    return values


def deviations(features: Sequence[Feature], metres: Double, noise: SensorNoise) -> Double:
    """Standard deviation of the noise on each feature, in the feature's own unit, [F].

    Args:
        features: a frame's.
        metres: in one unit of each feature that is a normalised distance, [F].
        noise: in metres and seconds.
    """
    known = noise.model_dump()
    return np.array(
        [
            known.get(feature.kind, 0.0) / (unit if feature.kind == "range" else 1.0)
            for feature, unit in zip(features, metres, strict=True)
        ]
    )


class Worsening:
    """Adds noise to a frame and then loses returns.

    Args:
        features: a frame's.
        metres: as for `deviations`.
        model: how much noise, and how many losses.
    """

    def __init__(
        self, features: Sequence[Feature], metres: Double, model: ObservationModel
    ) -> None:
        codes = {"flag": _FLAG, "range": _DISTANCE}
        self._deviations = deviations(features, metres, model.noise)
        self._codes = np.array([codes.get(f.kind, _PLAIN) for f in features], dtype=np.int64)
        self._returns = returns_of(features)
        self._owners = np.full(len(features), -1, dtype=np.int64)
        for index, (first, last) in enumerate(self._returns):
            self._owners[first:last] = index
        self._lost, self._dropout = lost_values(features), model.dropout

    @property
    def is_needed(self) -> bool:
        """Whether it changes anything."""
        return self._dropout > 0 or bool(self._deviations.any())

    def apply(self, now: Step, active: Bool, frame: Float) -> None:
        """Worsens the frames of the active copies in place, [E, N, F]."""
        worsen(
            now.seeds,
            now.times,
            active,
            self._deviations,
            self._codes,
            self._owners,
            self._returns,
            self._lost,
            self._dropout,
            normal_table(),
            frame,
        )


class History:
    """The last frames of each copy: gives those of `delay` steps ago and before, newest first.

    Before an episode's first frame there is nothing but that frame.

    Args:
        model: delay and stack.
        shape: of a frame, (E, N, F).
    """

    def __init__(self, model: ObservationModel, shape: tuple[int, int, int]) -> None:
        n_copies, n_agents, n_features = shape
        depth = model.delay + model.stack
        self._ring = np.zeros((n_copies, depth, n_agents, n_features), dtype=np.float32)
        self._counts = np.zeros(n_copies, dtype=np.int64)
        self._delay, self._stack = model.delay, model.stack

    def forget(self, copies: Int) -> None:
        """Lets the next frame of each of these copies be its first."""
        self._counts[copies] = 0

    def exchange(self, frame: Float, active: Bool, out: Float) -> None:
        """Remembers the frames of the active copies, [E, N, F]; writes [E, N, stack * F]."""
        exchange(self._ring, self._counts, frame, active, self._delay, self._stack, out)


def _numbered_prefix(feature: Feature) -> str:
    found = re.match(r".+_\d+(?=\.)", feature.name)
    return found.group() if found else ""


@kernel
def _draw_fates(
    row: Float, returns: Int, codes: Int, dropout: float, bits: int, fates: Int
) -> None:
    """Says of each return whether it is absent (0), present (1) or lost (2)."""
    for r in range(returns.shape[0]):
        fates[r] = 0
        for f in range(returns[r, 0], returns[r, 1]):
            if codes[f] == _FLAG and row[f] != 0.0:
                fates[r] = 1
        if fates[r] == 1 and dropout > 0.0 and to_uniform(absorb(bits, r)) < dropout:
            fates[r] = 2


@kernel
def worsen(
    seeds: Seeds,
    times: Int,
    active: Bool,
    deviations: Double,
    codes: Int,
    owners: Int,
    returns: Int,
    lost: Float,
    dropout: float,
    table: Double,
    frame: Float,
) -> None:
    """Adds noise to frames and loses returns.

    Args:
        seeds: of the episodes, [E].
        times: control steps since their reset, [E].
        active: copies to worsen, [E].
        deviations: of the noise on each feature, [F].
        codes: 1 for flags, 2 for normalised distances, else 0, [F].
        owners: return of each feature, or -1, [F].
        returns: first feature of each return and one past its last, [R, 2].
        lost: what each feature of a lost return reads, [F].
        dropout: probability that a return is lost.
        table: quantiles of the normal, as of `seeding.normal_table`.
        frame: changed, [E, N, F].
    """
    fates = np.empty(returns.shape[0], dtype=np.int64)
    for b in range(frame.shape[0]):
        if not active[b]:
            continue
        for i in range(frame.shape[1]):
            row = frame[b, i]
            robot = absorb(absorb(absorb(seeds[b], _STREAM), times[b]), i)
            noise = absorb(robot, _NOISE)
            _draw_fates(row, returns, codes, dropout, absorb(robot, _LOSS), fates)
            for f in range(owners.shape[0]):
                fate = fates[owners[f]] if owners[f] >= 0 else 1
                if fate == 2:
                    row[f] = lost[f]
                elif fate == 1 and deviations[f] > 0.0:
                    value = row[f] + deviations[f] * to_normal(absorb(noise, f), table)
                    row[f] = min(max(value, 0.0), 1.0) if codes[f] == _DISTANCE else value


@kernel
def exchange(
    ring: Float, counts: Int, frame: Float, active: Bool, delay: int, stack: int, out: Float
) -> None:
    """Puts frames into a ring and takes older ones out.

    Args:
        ring: frames of each copy, changed, [E, delay + stack, N, F].
        counts: frames since each episode's beginning, changed, [E].
        frame: the newest, [E, N, F].
        active: copies to serve, [E].
        delay: age of the newest frame to write, steps.
        stack: how many to write.
        out: written, newest first, [E, N, stack * F].
    """
    depth, n_features = ring.shape[1], ring.shape[3]
    for b in range(ring.shape[0]):
        if not active[b]:
            continue
        if counts[b] == 0:
            for slot in range(depth):
                ring[b, slot] = frame[b]
        newest = counts[b] % depth
        ring[b, newest] = frame[b]
        counts[b] += 1
        for k in range(stack):
            old = ring[b, (newest - delay - k) % depth]
            for i in range(ring.shape[2]):
                for f in range(n_features):
                    out[b, i, k * n_features + f] = old[i, f]
