"""Figures that are not drawn."""

import pytest

from tests.support.drawn import save_empty_figures


@pytest.fixture
def empty_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, and saved as empty files: drawing them takes most of a study's time.

    `test_pages_are_made_again_from_the_folder_alone` and the tests of files draw theirs.
    """
    save_empty_figures(monkeypatch)
