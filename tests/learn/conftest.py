"""A tiny dataset and its frame; without torch, only tests that need none are collected."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.hub.catalog.catalog import load
from swarmdata.perception.frames import Frame, find_frame
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task

NEED_NO_TORCH = ("test_overrides.py", "test_run_files.py", "test_search_space.py")


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    needs_torch = collection_path.suffix == ".py" and collection_path.name not in NEED_NO_TORCH
    return True if needs_torch and find_spec("torch") is None else None


@pytest.fixture(scope="session")
def data(tiny: Path) -> Dataset:
    return load(tiny)


@pytest.fixture(scope="session")
def frame(data: Dataset) -> Frame:
    found = find_frame(features_of(make_task(data.task)), "target")
    assert found is not None
    return found
