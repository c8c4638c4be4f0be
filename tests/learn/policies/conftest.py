"""A tiny dataset and its frame, for policies that were trained on it."""

import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.hub.catalog.catalog import load
from swarmdata.perception.frames import Frame, find_frame
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from tests.support.tiny import make_tiny


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return load(make_tiny(tmp_path_factory.mktemp("memory") / "coop_nav-tiny-v0"))


@pytest.fixture(scope="session")
def frame(data: Dataset) -> Frame:
    found = find_frame(features_of(make_task(data.task)), "target")
    assert found is not None
    return found
