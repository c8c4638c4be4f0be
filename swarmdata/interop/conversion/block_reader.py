"""Reads rows in large blocks where a format decodes whole chunks for every request."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.interop.conversion.episode_cuts import Read
from swarmdata.interop.conversion.kept_facts import BLOCK_BYTES


class Ahead:
    """A `Read` that asks for many rows at once and serves small slices from them.

    Slices should come in increasing order; others work and are slow.

    Args:
        read: gives some rows.
        n_rows: that there are.
        row_bytes: about how many bytes a row has, to bound what is held.
    """

    def __init__(self, read: Read, n_rows: int, row_bytes: int) -> None:
        self._read = read
        self._n_rows = n_rows
        self._block = max(1, BLOCK_BYTES // max(1, row_bytes))
        self._held: Mapping[str, NDArray[Any]] = {}
        self._start = self._stop = 0

    def __call__(self, window: slice) -> Mapping[str, NDArray[Any]]:
        """Returns the rows of `window`, whose start and stop are numbers."""
        if not self._start <= window.start <= window.stop <= self._stop:
            self._start = window.start
            self._stop = min(self._n_rows, max(window.stop, window.start + self._block))
            self._held = self._read(slice(self._start, self._stop))
        inside = slice(window.start - self._start, window.stop - self._start)
        return {name: np.asarray(values[inside]) for name, values in self._held.items()}
