"""What training needs of a dataset; `swarmdata.dataset.Dataset` and its views have it."""

from collections.abc import Mapping
from typing import Protocol

from swarmdata.learn.statistics import Episodes
from swarmdata.origins import RecordedSpec
from swarmdata.spec import TaskSpec
from swarmdata.types import Batch, Int


class Sampler(Protocol):
    """An endless seeded stream of batches, split into choosing rows and reading them."""

    def draw(self) -> Int: ...  # [B]
    def gather(self, index: Int) -> Batch: ...  # index [K, B] gives fields [K, B, ...]
    def state_dict(self) -> dict[str, int]: ...
    def load_state_dict(self, state: Mapping[str, int]) -> None: ...


class Data(Episodes, Protocol):
    """The part of a dataset, or of a view of one, that training needs."""

    @property
    def id(self) -> str: ...
    @property
    def digest(self) -> str: ...
    @property
    def view(self) -> str | None: ...  # models of a re-observation as JSON
    @property
    def spec(self) -> TaskSpec | RecordedSpec: ...
    def __len__(self) -> int: ...  # episodes
    def sampler(self, batch_size: int, *, seed: int) -> Sampler: ...
