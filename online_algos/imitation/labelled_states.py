"""The states that a team met while it clones a teacher, with what the teacher does there."""

import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import torch
from torch import Tensor

from swarmdata.errors import CheckpointError
from swarmdata.learn.training.replay_buffer import open_map


class LabelledStates:
    """What actors saw in the states met so far, and the teacher's actions there.

    `arrays` are memory for all rounds: inputs [R, capacity, I] and actions [R, capacity, A].
    """

    def __init__(self, arrays: Sequence[Tensor]) -> None:
        self.arrays, self._n_known = tuple(arrays), 0

    def __len__(self) -> int:
        """Samples of each network that are known."""
        return self._n_known

    def append(self, new: Sequence[Tensor]) -> None:
        """Adds inputs and actions, as `collect` returns them."""
        end = self._n_known + new[0].shape[1]
        for samples, x in zip(self.arrays, new, strict=True):
            samples[:, self._n_known : end] = x
        self._n_known = end


class StoredStates(LabelledStates):
    """Labelled states in files of a folder, which a resumed run finds as it left them.

    There is room for `n_rounds` of `n_samples` of each of R networks, whose inputs and actions have
    `widths` numbers, I and A.
    """

    def __init__(
        self, folder: Path, n_networks: int, n_rounds: int, n_samples: int, widths: tuple[int, int]
    ) -> None:
        self._n_samples, self._checksums = n_samples, list[int]()
        self._maps = {
            folder / name: open_map(folder / name, (n_networks, n_rounds * n_samples, width))
            for name, width in zip(("inputs.f32", "labels.f32"), widths, strict=True)
        }
        super().__init__([torch.from_numpy(each) for each in self._maps.values()])

    def append(self, new: Sequence[Tensor]) -> None:
        super().append(new)
        self._checksums.append(_checksum(new))

    def state_dict(self) -> dict[str, Tensor]:
        """A checksum of each round (CRC-32); the rounds are on disk when this returns."""
        for each in self._maps.values():
            each.flush()
        return {"checksums": torch.tensor(self._checksums, dtype=torch.int64)}

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        checksums = state["checksums"].tolist()
        for k, expected in enumerate(checksums):
            rows = slice(k * self._n_samples, (k + 1) * self._n_samples)
            if _checksum([x[:, rows] for x in self.arrays]) != expected:
                files = " and ".join(str(path) for path in self._maps)
                raise CheckpointError(
                    f"{files} do not hold round {k} as the checkpoint knows it: they are damaged, "
                    "or another run's. Train again in another folder."
                )
        self._checksums, self._n_known = checksums, len(checksums) * self._n_samples


def _checksum(arrays: Sequence[Tensor]) -> int:
    checksum = 0
    for each in arrays:
        checksum = zlib.crc32(each.contiguous().numpy().data, checksum)
    return checksum
