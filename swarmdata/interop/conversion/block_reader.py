"""BlockReader: reads rows in large blocks, for formats that decode whole chunks per request."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.interop.conversion.dataset_facts import BLOCK_BYTES
from swarmdata.interop.conversion.episode_cuts import ReadRows
from swarmdata.interop.conversion.foreign_file import reading


class BlockReader:
    """A `ReadRows` that reads many rows at once and serves small slices from them.

    Slices should come in increasing order; other orders work but are slow.

    Args:
        read: reads some rows.
        n_rows: number of rows.
        row_bytes: approximate size of a row, which bounds the memory.
        source: what is read, for errors: whatever `read` raises becomes one of ours.
    """

    def __init__(self, read: ReadRows, n_rows: int, row_bytes: int, source: Path | str) -> None:
        self._read, self._source = read, source
        self._n_rows = n_rows
        self._block = max(1, BLOCK_BYTES // max(1, row_bytes))
        self._held: Mapping[str, NDArray[Any]] = {}
        self._start = self._stop = 0

    def __call__(self, window: slice) -> Mapping[str, NDArray[Any]]:
        """Returns the rows of `window`, which has a start and a stop."""
        if not self._start <= window.start <= window.stop <= self._stop:
            self._start = window.start
            self._stop = min(self._n_rows, max(window.stop, window.start + self._block))
            with reading(self._source):
                self._held = self._read(slice(self._start, self._stop))
        inside = slice(window.start - self._start, window.stop - self._start)
        return {name: np.asarray(values[inside]) for name, values in self._held.items()}
