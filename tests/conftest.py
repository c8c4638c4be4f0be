"""Settings that every test shares."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# Before NumPy or torch start their thread pools: tests run small arrays, often several at once.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# the default run is the same every time; the nightly profile explores
settings.register_profile("quick", deadline=None, max_examples=15, derandomize=True)
settings.register_profile("nightly", deadline=None, max_examples=500)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "quick"))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden", action="store_true", help="rewrite golden files from what the code gives"
    )


@pytest.fixture
def update_golden(request: pytest.FixtureRequest) -> bool:
    """Whether golden files are to be rewritten instead of compared."""
    return bool(request.config.getoption("--update-golden"))


@pytest.fixture(autouse=True)
def cache_folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty dataset cache per test, so that no test reads or fills the user's."""
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setenv("SWARMDATA_CACHE", str(folder))
    return folder
