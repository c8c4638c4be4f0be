"""A dataset as robots see it that turn with an anchor: `frames.Frame` applied to every batch."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.learn.networks.dataset_statistics import step_weights
from swarmdata.learn.training.training_data import Data, Sampler
from swarmdata.perception.frames import Frame
from swarmdata.specs.origins import Spec
from swarmdata.types import Batch, Double, Episode, Int, Wanted

N_MEASURED = 20_000
"""Transitions whose observations are measured to normalize them."""


def framed(data: Data, frame: Frame | None) -> Data:
    """Returns the same data with observations and actions in a frame; as they are without one."""
    return data if frame is None else _FramedData(data, frame)


@dataclass(frozen=True, slots=True)
class _Moments:
    observation_mean: Double  # [O + 2 + C]
    observation_std: Double


class _FramedData:
    """Implements `Data`. Episodes that are read whole stay in the world's frame."""

    def __init__(self, data: Data, frame: Frame) -> None:
        self._data, self._frame = data, frame
        sampler = self.sampler(N_MEASURED, seed=0)
        observations = sampler.gather(sampler.draw()).observations.astype(np.float64)
        self.moments = _Moments(observations.mean((0, 1)), observations.std((0, 1)))

    @property
    def id(self) -> str:
        return self._data.id

    @property
    def digest(self) -> str:
        return self._data.digest

    @property
    def view(self) -> str | None:
        return self._data.view

    @property
    def spec(self) -> Spec:
        return self._data.spec

    @property
    def own_spec(self) -> Spec:
        return self._data.own_spec

    def __len__(self) -> int:
        return len(self._data)

    def step_weights(self) -> Double | None:
        return step_weights(self._data)

    def __iter__(self) -> Iterator[Episode]:
        return iter(self._data)

    def read(self, *names: str) -> Iterator[tuple[NDArray[Any], ...]]:
        return self._data.read(*names)

    def sampler(
        self,
        batch_size: int,
        *,
        horizon: int | None = None,
        burn_in: int | None = None,
        seed: int,
    ) -> Sampler:
        sampler = self._data.sampler(batch_size, horizon=horizon, burn_in=burn_in, seed=seed)
        return _FramedSampler(sampler, self._frame)

    def filter(self, *, min_return: float) -> Data:
        return _FramedData(self._data.filter(min_return=min_return), self._frame)


class _FramedSampler:
    """Implements `Sampler`."""

    def __init__(self, sampler: Sampler, frame: Frame) -> None:
        self._sampler, self._frame = sampler, frame

    def draw(self) -> Int:
        return self._sampler.draw()

    def gather(self, index: Int, wanted: Wanted = None) -> Batch:
        if wanted is not None:  # actions are turned by what is observed
            wanted = {*wanted, "observations"}
            wanted |= {"next_observations"} if "next_actions" in wanted else set()
        return self._frame.turned(self._sampler.gather(index, wanted))

    def state_dict(self) -> dict[str, int]:
        return self._sampler.state_dict()

    def load_state_dict(self, state: Mapping[str, int]) -> None:
        self._sampler.load_state_dict(state)
