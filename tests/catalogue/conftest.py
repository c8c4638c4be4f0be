"""One catalogue for all tests: every task, a lidar and a lossy radio, a recording with images."""

from collections.abc import Callable
from pathlib import Path

import pytest

from swarmdata.cards.card import write_card
from swarmdata.catalogue.build_catalogue import CatalogueChoices, build_catalogue
from swarmdata.registry.presets import preset
from swarmdata.specs.model_choice import with_models
from tests.support.image_world import record_images
from tests.support.tiny import TINY, make_tiny

TASKS = ("formation", "transport", "warehouse")


@pytest.fixture(scope="session")
def shown(tmp_path_factory: pytest.TempPathFactory, record: Callable[..., Path]) -> dict[str, Path]:
    """Folders of the datasets in the catalogue, by id."""
    root = tmp_path_factory.mktemp("shown")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SWARMDATA_CACHE", str(root / "cache"))
        sensed = with_models(TINY.spec, "lidar", "lossy-30+delayed-2")
        found = {
            "tiny": make_tiny(root / TINY.id),
            "peer": make_tiny(root / "coop_nav-peer-v0", id="coop_nav-peer-v0", spec=sensed),
        }
        write_card(found["tiny"])
        for name in TASKS:
            spec = preset(name).with_updates(horizon=30)
            found[name] = record(root / f"{name}-small-v0", spec, ("random",))
        found["images"] = record_images(root / "images").path
    return found


@pytest.fixture(scope="session")
def site(shown: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a catalogue of these datasets."""
    out = tmp_path_factory.mktemp("catalogue") / "site"
    build_catalogue([str(folder) for folder in shown.values()], out, CatalogueChoices())
    return out
