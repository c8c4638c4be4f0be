"""RecordedRows: the part of each batch that comes from a dataset, not from the replay.

Ball et al., "Efficient online reinforcement learning with offline data", ICML 2023, section 4.1:
symmetric sampling draws half of every batch from the data and half from the replay, for as long as
training lasts. Here the part is `share`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from swarmdata.errors import SchemaError, SpecError
from swarmdata.learn.training.training_data import Data, framed
from swarmdata.online_algos.collection.training_worlds import pack, unpack
from swarmdata.perception.frames import Frame
from swarmdata.specs.frozen import Frozen, describe_differences
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Batch


class RecordedSource(Frozen):
    """Which data a run mixes in, as its `config.json` keeps it."""

    id: str
    digest: str
    view: str | None = None  # changed models and weights, JSON
    n_episodes: Annotated[int, Field(ge=1)]  # of the part that is drawn from
    share: Annotated[float, Field(gt=0, lt=1)]  # of each batch

    @classmethod
    def of(cls, data: Data, share: float) -> "RecordedSource":
        """Describes data, of which batches are to have a share; SpecError unless in (0, 1)."""
        if not 0 < share < 1:
            raise SpecError(
                f"the offline share is {share:g}, expected above 0 and below 1: the part of each "
                "batch that is recorded. Leave out the data for none, and train offline for all."
            )
        return cls(
            id=data.id, digest=data.digest, view=data.view, n_episodes=len(data), share=share
        )

    def check(self, data: Data | None) -> None:
        """Raises SchemaError if data are not those described."""
        if data is None or RecordedSource.of(data, self.share) != self:
            got = "none" if data is None else repr(data)
            raise SchemaError(f"got the data {got}, expected {self.id} with digest {self.digest}")


def check_spec(data: Data, spec: TaskSpec | SideSpec) -> None:
    """Raises SchemaError if data were not recorded in a task, with its rewards."""
    if data.spec.hash() != spec.hash():
        raise SchemaError(
            f"{data.id} was recorded in {data.spec.task} with another spec: it differs in "
            f"{describe_differences(data.spec, spec)}. Mix in data of the task that is trained in."
        )


class RecordedRows:
    """Endless seeded streams of recorded transitions, one for each seed.

    Of a batch of `batch_size` rows, the part `share`, in (0, 1), is recorded, but at least one row
    of each kind is in it. `stored` gives what the algorithm stores of actions in [-1, 1], which are
    in the robots' `frame`; None: the world's.
    """

    def __init__(
        self,
        data: Data,
        frame: Frame | None,
        seeds: Sequence[int],
        batch_size: int,
        share: float,
        stored: Callable[[Tensor], Tensor],
    ) -> None:
        self._stored = stored
        self.n_rows = min(max(round(share * batch_size), 1), batch_size - 1)
        source = framed(data, frame)
        self._samplers = [source.sampler(self.n_rows, seed=seed) for seed in seeds]

    def draw(self) -> Batch:
        """Returns the next rows, tensors [K, n_rows, ...], not normalized."""
        index = np.stack([sampler.draw() for sampler in self._samplers])
        batch = self._samplers[0].gather(index).to_torch()
        return replace(batch, actions=self._stored(batch.actions))

    def state_dict(self) -> dict[str, Tensor]:
        """Places in the streams, as bytes."""
        return {"samplers": pack([sampler.state_dict() for sampler in self._samplers])}

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        for sampler, place in zip(self._samplers, unpack(state["samplers"]), strict=True):
            sampler.load_state_dict(place)


def joined(drawn: Batch, recorded: Batch) -> Batch:
    """Returns the rows of two batches [K, B, ...] as one; fields of only one are left out."""
    names = (
        "observations", "actions", "rewards", "next_observations", "states", "next_states",
        "terminations", "truncations", "mask",
    )  # fmt: skip
    fields = {n: torch.cat([getattr(drawn, n), getattr(recorded, n)], 1) for n in names}
    return Batch(**fields)
