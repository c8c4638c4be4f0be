"""Tiny datasets."""

from pathlib import Path

import pytest

pytest.importorskip("torch", reason="tuning needs the torch extra")

from swarmdata.specs.recipe import Splits
from tests.evaluation.study.conftest import data
from tests.support.tiny import make_tiny

__all__ = ["data", "other_data"]


@pytest.fixture(scope="session")
def other_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of another tiny dataset of the same task, with validation episodes."""
    folder = tmp_path_factory.mktemp("other") / "coop_nav-other-v0"
    return make_tiny(folder, id="coop_nav-other-v0", seed=6, splits=Splits(block=4))
