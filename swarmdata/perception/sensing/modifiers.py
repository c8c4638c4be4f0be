"""Frame modifiers: delay, stacking, and noise and losses of echoes (lidar beams, grid cells)."""

import itertools
import math
import re
from collections.abc import Sequence

import numpy as np

from swarmdata.numerics.episode_draws import NOISE_FIELD, draw_share
from swarmdata.numerics.random import STREAMS, normal_table
from swarmdata.numerics.random_kernels import absorb, to_normal, to_uniform
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.features import Feature
from swarmdata.specs.sensing_models import LidarModel, ObservationModel
from swarmdata.types import Bool, Double, Float, Int, Seeds, Step

_SENSOR_STREAM = STREAMS["sensor"]
_NOISE, _LOSS = 0, 1
"""Last counter but one of each draw; the last is the index of the feature, or of the echo."""

NO_ECHOES = np.zeros((0, 2), dtype=np.int64)  # the echoes of models that measure objects


def echoes_of(features: Sequence[Feature]) -> Int:
    """Returns the first feature of each echo, such as `beam_3`, and one past its last, [R, 2]."""
    found, first = [], 0
    for prefix, run in itertools.groupby(features, _numbered_prefix):
        group = list(run)
        if prefix and any(feature.kind == "flag" for feature in group):
            found.append((first, first + len(group)))
        first += len(group)
    return np.array(found, dtype=np.int64).reshape(-1, 2)


class Echoes:
    """Adds noise to the distances of echoes, in [0, 1]; a lost echo reads as if it hit nothing.

    `echoes` are those of `echoes_of`, `drawn` is the range (m) of noise that episodes draw.
    """

    def __init__(
        self,
        features: Sequence[Feature],
        echoes: Int,
        model: ObservationModel,
        drawn: tuple[float, float] | None = None,
    ) -> None:
        reach = model.range if isinstance(model, LidarModel) else math.inf
        low, high = (model.noise.range,) * 2 if drawn is None else drawn
        is_distance = np.array([feature.kind == "range" for feature in features], dtype=np.bool_)
        self._echoes, self._is_distance = echoes, is_distance
        self._deviation, self._spread = low / reach, (high - low) / reach
        self._dropout = model.dropout

    @property
    def are_degraded(self) -> bool:
        """Whether there are echoes and they have noise or losses."""
        return len(self._echoes) > 0 and (self._dropout > 0 or self._deviation + self._spread > 0)

    def degrade(self, step: Step, active: Bool, frame: Float) -> None:
        """Adds noise and losses to the echoes of the active copies in place, [E, N, F]."""
        degrade(
            step.seeds, step.times, active, self._echoes, self._is_distance, self._deviation,
            self._spread, self._dropout, normal_table(), frame,
        )  # fmt: skip


class History:
    """Keeps the last frames of each copy and returns those from `delay` steps ago, newest first.

    Frames, [E, N, F], from before an episode's first one are copies of it; `stack` are returned.
    """

    def __init__(self, shape: tuple[int, int, int], delay: int, stack: int = 1) -> None:
        n_copies, n_agents, n_features = shape
        depth = delay + stack
        self._ring = np.zeros((n_copies, depth, n_agents, n_features), dtype=np.float32)
        self._counts = np.zeros(n_copies, dtype=np.int64)
        self._delay, self._stack = delay, stack

    def forget(self, copies: Int) -> None:
        self._counts[copies] = 0

    def exchange(self, frame: Float, active: Bool, out: Float) -> None:
        """Remembers the frames of the active copies, [E, N, F]; writes [E, N, stack * F]."""
        exchange(self._ring, self._counts, frame, active, self._delay, self._stack, out)


def _numbered_prefix(feature: Feature) -> str:
    found = re.match(r".+_\d+(?=\.)", feature.name)
    return found.group() if found else ""


@kernel
def degrade(
    seeds: Seeds,  # [E] of the episodes
    times: Int,  # [E] control steps since their reset
    active: Bool,  # [E] copies to change
    echoes: Int,  # [R, 2] first feature of each echo and one past its last
    is_distance: Bool,  # [F] which features are distances; the others of an echo are flags
    least: float,  # deviation of the noise on a distance, in its own unit
    spread: float,  # how much larger the deviation may be that an episode draws
    dropout: float,  # probability that an echo is lost
    table: Double,  # quantiles of the normal distribution, from `random.normal_table`
    frame: Float,  # [E, N, F] changed
) -> None:
    """Adds noise to echoes and loses some of them."""
    for b in range(frame.shape[0]):
        if not active[b]:
            continue
        for i in range(frame.shape[1]):
            row = frame[b, i]
            deviation = least + spread * draw_share(seeds[b], NOISE_FIELD, i)
            robot = absorb(absorb(absorb(seeds[b], _SENSOR_STREAM), times[b]), i)
            noise, loss = absorb(robot, _NOISE), absorb(robot, _LOSS)
            for r in range(echoes.shape[0]):
                first, last = echoes[r]
                has_hit = False
                for f in range(first, last):
                    has_hit |= not is_distance[f] and row[f] != 0.0
                if not has_hit:
                    continue
                is_lost = dropout > 0.0 and to_uniform(absorb(loss, r)) < dropout
                for f in range(first, last):
                    if is_lost:
                        row[f] = 1.0 if is_distance[f] else 0.0
                    elif is_distance[f] and deviation > 0.0:
                        value = row[f] + deviation * to_normal(absorb(noise, f), table)
                        row[f] = min(max(value, 0.0), 1.0)


@kernel
def exchange(
    ring: Float,  # [E, delay + stack, N, F] frames of each copy, changed
    counts: Int,  # [E] frames since the start of each episode, changed
    frame: Float,  # [E, N, F] the newest
    active: Bool,  # [E] copies to change
    delay: int,  # age of the newest frame to write, steps
    stack: int,  # number of frames to write
    out: Float,  # [E, N, stack * F] written, newest first
) -> None:
    """Puts frames into a ring and takes older ones out."""
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
