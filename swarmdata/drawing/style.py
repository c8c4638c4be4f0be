"""The style of every figure: colors, fonts, and how a figure is made and saved."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from swarmdata.errors import MissingExtraError, SchemaError
from swarmdata.runtime.atomic import staged

COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#785E3C")
"""From Okabe and Ito, "Color Universal Design", 2008; the same as of the robots."""

INK, GRAY, FAINT = "#2D333C", "#7A818B", "#E3E5E8"
"""Of text and axes, of what stands back, and of grids."""

DPI = 160

SUFFIXES = (".png", ".svg", ".pdf")

_STYLE = {
    "font.size": 10,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
    "svg.hashsalt": "swarmdata",  # the same file for the same figure
}


def colors(n: int) -> list[str]:
    """One color for each of n lines; they repeat after six."""
    return [COLORS[k % len(COLORS)] for k in range(n)]


def thousands(value: float, _position: int = 0) -> str:
    """10000 as 10k, 2000000 as 2M; a formatter of ticks."""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= size:
            return f"{value / size:g}{letter}"
    return f"{value:g}"


@contextmanager
def figure(
    path: Path, *, width: float, height: float, purpose: str = "drawing a figure"
) -> Iterator[Any]:
    """A figure in inches, in the house style, saved at the end; pyplot's global state stays.

    Args:
        path: where to save; the suffix is the format.
        width: inches.
        height: inches.
        purpose: what needs matplotlib, for the error.

    Raises:
        SchemaError: an unknown suffix.
        MissingExtraError: matplotlib is not installed.
        DiskFullError: no space was left.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise SchemaError(f"{path} has suffix {path.suffix!r}, expected one of {SUFFIXES}.")
    try:
        import matplotlib as mpl  # noqa: PLC0415  (matplotlib is an extra)
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError as error:
        raise MissingExtraError("matplotlib", "plots", purpose) from error
    with mpl.rc_context({**mpl.rcParamsDefault, "backend": "agg", **_STYLE}):
        drawing = Figure(figsize=(width, height), layout="constrained")
        yield drawing
        dated = {".png": {}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
        with staged(path) as target:
            drawing.savefig(target, dpi=DPI, metadata=dated[path.suffix.lower()])
