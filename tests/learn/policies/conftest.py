"""A tiny dataset and its frame, for policies that were trained on it."""

from pathlib import Path

import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.hub.catalog.catalog import load
from swarmdata.perception.frames import Frame, find_frame
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task


@pytest.fixture(scope="session")
def data(tiny: Path) -> Dataset:
    return load(tiny)


@pytest.fixture(scope="session")
def frame(data: Dataset) -> Frame:
    found = find_frame(features_of(make_task(data.task)), "target")
    assert found is not None
    return found
