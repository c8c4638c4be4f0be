"""A tiny dataset to train on."""

from pathlib import Path

import pytest

from swarmdata.datasets.dataset import Dataset


@pytest.fixture(scope="session")
def tiny(tiny: Path) -> Dataset:
    return Dataset.open(tiny)
