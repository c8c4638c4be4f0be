"""Episode tables of which a test needs a few columns."""

from dataclasses import fields
from typing import Any

import numpy as np

from swarmdata.store import EpisodeTable


def episode_table(n: int, **columns: Any) -> EpisodeTable:
    """A table of n episodes; columns that are not given are zero."""
    zeros = {field.name: np.zeros(n, np.int64) for field in fields(EpisodeTable)}
    given = {name: np.asarray(values) for name, values in columns.items()}
    return EpisodeTable(**{**zeros, **given})
