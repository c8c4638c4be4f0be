"""Batches for a torch `DataLoader`: one stream, at which its worker processes take turns."""

import contextlib
from collections.abc import Iterator
from typing import Any, NoReturn

from torch.utils.data import IterableDataset, get_worker_info

from swarmdata.datasets.sampling import SampledView
from swarmdata.errors import SchemaError
from swarmdata.types import Batch, Episode


class TorchBatches(IterableDataset[Batch]):
    """The batches of `view.sampler(**options)` as tensors, in every process of a loader its share.

    Of W workers the k-th gathers batches k, k + W, k + 2 W, ... of the stream; a loader asks its
    workers in turn, and so yields the stream in order.

    Raises:
        SchemaError: as the sampler.
    """

    def __init__(self, view: SampledView, **options: Any) -> None:
        super().__init__()
        view.sampler(**options)  # mistakes are refused here, not in a worker
        self._view, self._options = view, options

    def __iter__(self) -> Iterator[Batch]:
        worker = get_worker_info()
        first, n_workers = (0, 1) if worker is None else (worker.id, worker.num_workers)
        sampler = self._view.sampler(**self._options)
        number = 0
        while True:
            index = sampler.draw()
            if number % n_workers == first:
                yield sampler.gather(index).to_torch()
            number += 1

    def __repr__(self) -> str:
        return f"<batches of {self._view!r:.200}>"


def explain_stacking() -> None:
    """Makes torch's default collation say why it cannot stack episodes, and what can be done.

    Functions of a type are added to its table as torch documents it; where a version of torch has
    no such table, its own message remains.
    """
    with contextlib.suppress(ImportError):
        from torch.utils.data._utils.collate import default_collate_fn_map  # noqa: PLC0415

        default_collate_fn_map[Episode] = _refuse


def _refuse(batch: list[Episode], *, collate_fn_map: object = None) -> NoReturn:
    raise SchemaError(
        f"a DataLoader cannot stack {len(batch)} episodes, whose lengths differ. Load batches of "
        "steps with DataLoader(dataset.to_torch(256), batch_size=None), single episodes with "
        "DataLoader(dataset, batch_size=None), or pass a collate_fn of your own."
    )
