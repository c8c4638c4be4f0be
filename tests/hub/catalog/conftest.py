"""The tiny dataset, as it is or as one that the package has published."""

import shutil
from pathlib import Path
from types import MappingProxyType

import pytest

from swarmdata.hub.catalog import identity, repair
from swarmdata.registry.published import Published
from swarmdata.store import open_store
from swarmdata.store.publication import publication
from tests.support.tiny import TINY


@pytest.fixture
def dataset(tiny: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(tiny, tmp_path / TINY.id))


@pytest.fixture
def published(monkeypatch: pytest.MonkeyPatch, tiny: Path) -> Published:
    """The tiny dataset is published, and its recipe shipped."""
    entry = publication(open_store(tiny))
    monkeypatch.setattr(identity, "published", lambda: MappingProxyType({TINY.id: entry}))
    for module in (repair, identity):
        monkeypatch.setattr(module, "shipped_recipes", lambda: {TINY.id: TINY})
    return entry
