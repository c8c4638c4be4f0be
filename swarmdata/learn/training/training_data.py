"""The part of a dataset that training needs; `datasets.dataset.Dataset` and its views have it."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from swarmdata.learn.networks.dataset_statistics import Episodes
from swarmdata.specs.origins import Spec
from swarmdata.types import Batch, Double, Int, Wanted


class Sampler(Protocol):
    """An endless seeded stream of batches, split into choosing rows and reading them."""

    def draw(self) -> Int: ...  # [B]
    def gather(self, index: Int, wanted: Wanted = None) -> Batch: ...
    # [K, B] gives fields [K, B, ...], or [K, B, L, ...]; None for those that are not wanted
    def state_dict(self) -> dict[str, int]: ...
    def load_state_dict(self, state: Mapping[str, int]) -> None: ...


class Data(Episodes, Protocol):
    """The part of a dataset, or of a view of one, that training needs."""

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
    def __len__(self) -> int: ...  # episodes
    def sampler(
        self,
        batch_size: int,
        *,
        horizon: int | None = None,
        burn_in: int | None = None,
        seed: int,
    ) -> Sampler: ...
    def filter(self, *, min_return: float) -> "Data": ...  # episodes of at least this team return


@runtime_checkable
class Selective(Protocol):
    """A config of an algorithm that learns from the best episodes only.

    The trainer asks it once, before it measures statistics and draws batches, and the run's
    `min_return` keeps the answer: `dataset.filter(min_return=...)` is what was learned from.
    """

    def least_return(self, returns: Double) -> float:
        """Returns the least team return that is learned from, of those of all episodes, [n]."""
        ...
