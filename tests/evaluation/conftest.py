"""Figures that are not drawn."""

import pytest

from tests.support.drawn import save_empty_figures


@pytest.fixture
def empty_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, and saved as empty files: drawing them takes most of a study's time."""
    save_empty_figures(monkeypatch)
