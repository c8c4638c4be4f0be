"""A tiny dataset to train on."""

import pytest

from swarmdata.datasets.dataset import Dataset
from tests.support.tiny import make_tiny


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return Dataset.open(make_tiny(tmp_path_factory.mktemp("tiny") / "tiny"))
