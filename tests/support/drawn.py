"""Figures as objects, for tests of what they show."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from swarmdata.drawing import style


def save_empty_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are saved as empty files: drawing one for each format takes seconds."""
    figure = pytest.importorskip("matplotlib.figure", reason="figures need the plots extra")

    def save(self: object, target: Path, **settings: object) -> None:
        Path(target).touch()

    monkeypatch.setattr(figure.Figure, "savefig", save)


def shown_figure(
    monkeypatch: pytest.MonkeyPatch, module: ModuleType, draw: Callable[[], None]
) -> Any:
    """Draws with a function of a module, and returns the figure, laid out; its file is empty."""
    drawn = []
    save_empty_figures(monkeypatch)

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


def label_faults(drawing: Any) -> list[str]:
    """Labels of a laid out figure that are cut off, or that lie on one another."""
    texts = [text for text in _texts(drawing) if text.get_visible() and text.get_text().strip()]
    boxes = [text.get_window_extent() for text in texts]
    page = drawing.bbox
    found = [
        f"{text.get_text()!r} is cut off"
        for text, box in zip(texts, boxes, strict=True)
        if box.x0 < -1 or box.y0 < -1 or box.x1 > page.x1 + 1 or box.y1 > page.y1 + 1
    ]
    for k, (one, box) in enumerate(zip(texts, boxes, strict=True)):
        for other, beside in zip(texts[k + 1 :], boxes[k + 1 :], strict=True):
            if _overlap(one, box, other, beside):
                found.append(f"{one.get_text()!r} lies on {other.get_text()!r}")
    return found


def _texts(drawing: Any) -> Iterator[Any]:
    """All texts of a figure; of ticks those within the limits."""
    yield from drawing.texts
    for legend in drawing.legends:
        yield from legend.get_texts()
    for axes in drawing.axes:
        if not axes.get_visible():
            continue
        yield from (axes.title, axes._left_title, axes._right_title, *axes.texts)
        for axis in (axes.xaxis, axes.yaxis):
            yield axis.label
            low, high = sorted(axis.get_view_interval())
            for tick in axis.get_major_ticks():
                if low <= tick.get_loc() <= high:
                    yield from (tick.label1, tick.label2)


def _overlap(one: Any, box: Any, other: Any, beside: Any) -> bool:
    """Whether two boxes share more than a pixel; leaning labels are apart across their lines."""
    if one.get_rotation() == other.get_rotation() == 45:
        apart = abs((box.x0 - beside.x0) - (box.y0 - beside.y0)) / 2**0.5
        return bool(apart < one.get_fontsize())
    wide = min(box.x1, beside.x1) - max(box.x0, beside.x0)
    high = min(box.y1, beside.y1) - max(box.y0, beside.y0)
    return bool(wide > 1.0 and high > 1.0)
