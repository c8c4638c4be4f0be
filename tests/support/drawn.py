"""Figures as objects, for tests of what they show."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import pytest

from swarmdata.drawing import style


def shown_figure(
    monkeypatch: pytest.MonkeyPatch, module: ModuleType, draw: Callable[[], None]
) -> Any:
    """Draws with a function of a module, and returns the figure, laid out."""
    drawn = []

    @contextmanager
    def kept(*args: Any, **kwargs: Any) -> Iterator[Any]:
        with style.figure(*args, **kwargs) as drawing:
            yield drawing
            drawing.draw_without_rendering()
            drawn.append(drawing)

    monkeypatch.setattr(module, "figure", kept)
    draw()
    (found,) = drawn
    return found
