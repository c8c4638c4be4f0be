"""Figures as objects."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.support.drawn import shown_figure

Shown = Callable[[ModuleType, Callable[[Path], None]], Any]


@pytest.fixture
def shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Shown:
    """Draws with a function of a module, and returns the figure."""
    return lambda module, draw: shown_figure(monkeypatch, module, lambda: draw(tmp_path / "a.png"))
