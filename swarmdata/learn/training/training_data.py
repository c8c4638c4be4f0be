"""The part of a dataset that training needs, and the same as robots see it in a frame."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np

from swarmdata.learn.networks.dataset_statistics import Episodes
from swarmdata.perception.frames import Frame
from swarmdata.specs.origins import Spec
from swarmdata.types import Batch, Double, Episode, Int, Wanted


class Sampler(Protocol):
    """An endless seeded stream of batches, split into choosing rows and reading them."""

    def draw(self) -> Int: ...  # [B]
    def gather(self, index: Int, wanted: Wanted = None) -> Batch: ...
    # [K, B] gives fields [K, B, ...], or [K, B, L, ...]; None for those that are not wanted
    def state_dict(self) -> dict[str, int]: ...
    def load_state_dict(self, state: Mapping[str, int]) -> None: ...


class Data(Episodes, Protocol):
    """What training needs of a dataset; `datasets.dataset.Dataset` and its views have it."""

    @property
    def id(self) -> str: ...
    @property
    def digest(self) -> str: ...
    @property
    def view(self) -> str | None: ...  # changed models and reward weights as JSON
    @property
    def spec(self) -> Spec: ...
    @property
    def own_spec(self) -> Spec: ...  # as recorded
    def sampler(
        self, batch_size: int, *, horizon: int | None = None, burn_in: int | None = None, seed: int
    ) -> Sampler: ...
    def filter(self, *, min_return: float) -> "Data": ...  # episodes of at least this team return


@runtime_checkable
class Selective(Protocol):
    """A config of an algorithm that learns from the best episodes only, asked once, at first."""

    def least_return(self, returns: Double) -> float:
        """Returns the least team return that is learned from, of those of all episodes, [n]."""
        ...


N_MEASURED = 20_000
"""Transitions whose observations are measured to normalize them."""


def framed(data: Data, frame: Frame | None) -> Data:
    """Returns the same data with observations and actions in a frame; as they are without one."""
    return data if frame is None else cast("Data", _FramedData(data, frame))


@dataclass(frozen=True, slots=True)
class _Moments:
    observation_mean: Double  # [O + 2 + C]
    observation_std: Double


class _FramedData:
    """Implements `Data`; all else is the data's, whole episodes in the world's frame."""

    def __init__(self, data: Data, frame: Frame) -> None:
        self._data, self._frame = data, frame
        sampler = self.sampler(N_MEASURED, seed=0)
        observations = sampler.gather(sampler.draw()).observations.astype(np.float64)
        self.moments = _Moments(observations.mean((0, 1)), observations.std((0, 1)))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._data, name)

    def __len__(self) -> int:
        return len(self._data)

    def __iter__(self) -> Iterator[Episode]:
        return iter(self._data)

    def sampler(self, batch_size: int, **options: Any) -> Sampler:
        sampler = _FramedSampler(self._data.sampler(batch_size, **options), self._frame)
        return cast("Sampler", sampler)

    def filter(self, *, min_return: float) -> Data:
        return framed(self._data.filter(min_return=min_return), self._frame)


class _FramedSampler:
    """Implements `Sampler`; all else is that of the data's."""

    def __init__(self, sampler: Sampler, frame: Frame) -> None:
        self._sampler, self._frame = sampler, frame

    def __getattr__(self, name: str) -> Any:
        return getattr(self._sampler, name)

    def gather(self, index: Int, wanted: Wanted = None) -> Batch:
        if wanted is not None:  # actions are turned by what is observed
            wanted = {*wanted, "observations"}
            wanted |= {"next_observations"} if "next_actions" in wanted else set()
        return self._frame.turned(self._sampler.gather(index, wanted))
