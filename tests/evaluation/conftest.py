"""Tiny datasets, and figures that are not drawn."""

from pathlib import Path

import pytest

from swarmdata.specs.recipe import Splits
from tests.support.drawn import save_empty_figures
from tests.support.tiny import make_tiny


@pytest.fixture
def empty_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, and saved as empty files: drawing them takes most of a study's time."""
    save_empty_figures(monkeypatch)


@pytest.fixture(scope="session")
def data(tiny: Path) -> Path:
    """Folder of a tiny dataset."""
    return tiny


@pytest.fixture(scope="session")
def other_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of another tiny dataset of the same task, with validation episodes."""
    folder = tmp_path_factory.mktemp("other") / "coop_nav-other-v0"
    return make_tiny(folder, id="coop_nav-other-v0", seed=6, splits=Splits(block=4))
