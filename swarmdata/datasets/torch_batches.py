"""Batches for a torch `DataLoader`: one stream, at which its worker processes take turns."""

import contextlib
from collections.abc import Iterator
from dataclasses import fields
from typing import Any, NoReturn

import torch
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
                batch = sampler.gather(index).to_torch()
                yield batch if worker is None else _SentBatch(**_values(batch))
            number += 1

    def __repr__(self) -> str:
        return f"<batches of {self._view!r:.200}>"


class _SentBatch(Batch):
    """Tensors that a worker sends as arrays: torch would open a file for each of them."""

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        arrays = {name: v.numpy() for name, v in _values(self).items() if _is_plain(v)}
        others = {name: v for name, v in _values(self).items() if name not in arrays}
        return _received, (arrays, others)


def _received(arrays: dict[str, Any], others: dict[str, Any]) -> Batch:
    return Batch(**{name: torch.from_numpy(array) for name, array in arrays.items()}, **others)


def _values(batch: Batch) -> dict[str, Any]:
    return {field.name: getattr(batch, field.name) for field in fields(Batch)}


def _is_plain(value: object) -> bool:
    """Whether it is a tensor as samplers give it, not one that a `collate_fn` moved or cast."""
    kinds = (torch.float32, torch.uint8, torch.bool, torch.int64)
    if not isinstance(value, torch.Tensor):
        return False
    return value.is_cpu and value.dtype in kinds and not value.requires_grad


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
