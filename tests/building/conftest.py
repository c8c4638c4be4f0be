"""The tiny dataset in smaller parts, which are no part of its digest."""

from pathlib import Path

import pytest

from swarmdata.store import read_manifest
from tests.support.tiny import TINY

SMALL = TINY.model_copy(update={"part_episodes": 2})


@pytest.fixture(scope="session")
def tiny_digest(tiny: Path) -> str:
    return read_manifest(tiny).digest
