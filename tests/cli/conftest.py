"""A small dataset with a card; nobody may change it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from swarmdata.cards.card import write_card
from swarmdata.registry.presets import preset

ID = "coop_nav-small-v0"


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory, record: Callable[..., Path]) -> Path:
    folder = tmp_path_factory.mktemp("commands") / ID
    record(folder, preset("coop_nav").with_updates(horizon=10), ("random",))
    write_card(folder)
    return folder
