"""The style of every figure: colors, fonts, and how a figure is made and saved."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from swarmdata.errors import MissingExtraError, SchemaError
from swarmdata.runtime.atomic import staged

COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#785E3C")
"""From Okabe and Ito, "Color Universal Design", 2008; robots are drawn in the same colors."""

INK, GRAY, FAINT = "#2D333C", "#7A818B", "#E3E5E8"
"""Of text and axes, of the background, and of grid lines."""

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">", "p", "h", "d")
"""Of points that share a color."""

DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)))
"""Of lines that share a color, in matplotlib's notation."""

DATA_LINE: Mapping[str, Any] = {"color": INK, "lw": 1.0, "ls": (0, (4, 2))}
"""The mean of a dataset's own episodes, in every figure that shows it."""

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


def line_style(k: int) -> dict[str, Any]:
    """Color and dashes of line k: the dashes change once the colors repeat."""
    return {"color": COLORS[k % len(COLORS)], "ls": DASHES[(k // len(COLORS)) % len(DASHES)]}


def family_looks(families: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Returns a color and a marker of each label: the color of its family, a marker of its own.

    With more families than colors, families share a color, and no marker in it repeats.

    Args:
        families: label -> family, in the order of the tables.
    """
    kinds = list(dict.fromkeys(families.values()))
    counts = dict.fromkeys(COLORS, 0)
    looks = {}
    for label, family in families.items():
        color = COLORS[kinds.index(family) % len(COLORS)]
        looks[label] = {"color": color, "marker": MARKERS[counts[color] % len(MARKERS)]}
        counts[color] += 1
    return looks


def draw_grid(axes: Any, axis: Literal["both", "x", "y"] = "both", width: float = 0.8) -> None:
    """Draws a faint grid behind the data."""
    axes.grid(axis=axis, color=FAINT, lw=width)
    axes.set_axisbelow(True)


def thousands(value: float, _position: int = 0) -> str:
    """Formats ticks: 10000 as 10k, 2000000 as 2M."""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= size:
            return f"{value / size:g}{letter}"
    return f"{value:g}"


@contextmanager
def figure(
    path: Path, *, width: float, height: float, purpose: str = "drawing a figure"
) -> Iterator[Any]:
    """Makes a figure in the project's style and saves it at the end; pyplot's state is unchanged.

    Args:
        path: where to save; the suffix is the format.
        width: inches.
        height: inches.
        purpose: for the error message if matplotlib is missing.

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
