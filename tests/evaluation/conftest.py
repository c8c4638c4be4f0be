"""Figures that are not drawn."""

from pathlib import Path

import pytest


@pytest.fixture
def empty_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made, and saved as empty files: drawing them takes most of a study's time.

    `tests/evaluation/figures` and `test_pages_are_made_again_from_the_folder_alone` draw theirs.
    """
    figure = pytest.importorskip("matplotlib.figure", reason="figures need the plots extra")

    def save(self: object, target: Path, **settings: object) -> None:
        Path(target).touch()

    monkeypatch.setattr(figure.Figure, "savefig", save)
