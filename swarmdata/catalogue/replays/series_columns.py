"""The numbers with which the catalogue plots an episode of another library's environment.

Rewards, actions and observations are lines, rounded to a thousandth of their range, or images.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmdata.catalogue.replays.world_columns import Columns
from swarmdata.specs.origins import Spec
from swarmdata.specs.spaces import BoxSpace
from swarmdata.types import Double, Episode, Int

MOST_LINES = 12
"""Columns of an array that are drawn for each agent; the page says how many there are."""

N_LEVELS = 1000
UNDEFINED = -1  # code of a value that is not finite

IMAGE_SIDE = 48  # pixels, of the longer side
IMAGE_FRAMES = 40  # of an episode
IMAGE_EPISODES = 10
COLOR_CHANNELS = (1, 3, 4)


class Panel(NamedTuple):
    """One plot of each agent: some columns of an array."""

    name: str
    n_shown: int
    n_columns: int


class SeriesColumns:
    """Turns episodes into integers, and describes them to the browser.

    The ranges of all episodes that are shown are the axes of the plots.
    """

    def __init__(self, spec: Spec, episodes: Sequence[Episode]) -> None:
        self.spec = spec
        n_columns = episodes[0].observations.shape[-1]
        self.image_shape = _image_shape(spec, n_columns)
        n_observed = 0 if self.image_shape else n_columns
        sizes = {"reward": 1, "action": spec.action_size, "observation": n_observed}
        self.panels = [
            Panel(name, min(size, MOST_LINES), size) for name, size in sizes.items() if size
        ]
        lows, highs = [], []
        for episode in episodes:
            values = self._values(episode)
            lows.append(np.where(np.isfinite(values), values, np.inf).min(axis=0))
            highs.append(np.where(np.isfinite(values), values, -np.inf).max(axis=0))
        low, high = np.min(lows, axis=0), np.max(highs, axis=0)
        self._low = np.where(np.isfinite(low), low, 0.0)  # nothing is finite: no line
        self._high = np.where(high > self._low, high, self._low + 1.0)

    def moving(self, episode: Episode) -> Int:
        """Codes of all lines, panel by panel and agent by agent, [T+1, lines]."""
        values = self._values(episode)
        is_finite = np.isfinite(values)
        shares = (np.where(is_finite, values, 0.0) - self._low) / (self._high - self._low)
        codes = np.rint(shares * N_LEVELS)
        return np.where(is_finite, codes, UNDEFINED).astype(np.int64)

    def images(self, episode: Episode) -> tuple[Int, Columns]:
        """Which states are shown as images, [K], and their pixels, [K, agents * H * W * 3]."""
        assert self.image_shape is not None
        rows, columns = self.shown_shape
        shown = np.unique(np.linspace(0, len(episode), IMAGE_FRAMES).astype(np.int64))
        height, width, channels = self.image_shape
        n_pixels = height * width * channels
        pixels = episode.observations[shown][..., :n_pixels]
        pixels = pixels.reshape(len(shown), self.spec.n_agents, height, width, channels)
        down = np.arange(rows) * height // rows
        across = np.arange(columns) * width // columns
        small = pixels[:, :, down][:, :, :, across]
        color = small[..., :3] if channels >= 3 else np.repeat(small, 3, axis=-1)
        return shown, np.clip(color, 0, 255).astype(np.int64).reshape(len(shown), -1)

    @property
    def shown_shape(self) -> tuple[int, int]:
        """Height and width of images on the page, pixels."""
        assert self.image_shape is not None
        height, width, _ = self.image_shape
        shrink = max(1.0, max(height, width) / IMAGE_SIDE)
        return max(1, round(height / shrink)), max(1, round(width / shrink))

    def describe(self) -> dict[str, Any]:
        """What the browser needs to know of the recording, JSON."""
        return {
            "task": self.spec.task,
            "names": list(self.spec.agent_names),
            "panels": [list(each) for each in self.panels],
            "low": _rounded(self._low),
            "high": _rounded(self._high),
            "levels": N_LEVELS,
            "image": list(self.shown_shape) if self.image_shape else None,
        }

    def _values(self, episode: Episode) -> Double:
        """All lines of an episode, [T+1, lines]; those of steps follow a first row of NaN."""
        arrays: dict[str, NDArray[Any]] = {
            "reward": episode.rewards[..., None],
            "action": episode.actions,
            "observation": episode.observations,
        }
        lines = []
        for panel in self.panels:
            array = arrays[panel.name][..., : panel.n_shown].astype(np.float64)
            if panel.name != "observation":
                array = np.concatenate([np.full_like(array[:1], np.nan), array])
            lines.append(array.reshape(len(array), -1))
        return np.concatenate(lines, axis=1)


def _image_shape(spec: Spec, n_columns: int) -> tuple[int, int, int] | None:
    """Shape of every agent's observations if all are images of bytes of one shape."""
    space, *others = spec.observation_spaces(n_columns)
    if (
        any(other != space for other in others)
        or not isinstance(space, BoxSpace)
        or space.dtype != "uint8"
    ):
        return None
    shape = space.shape
    if len(shape) == 2:
        return shape[0], shape[1], 1
    if len(shape) == 3 and shape[2] in COLOR_CHANNELS:
        return shape[0], shape[1], shape[2]
    return None


def _rounded(values: Double) -> list[float]:
    return [float(f"{value:.4g}") for value in values]
