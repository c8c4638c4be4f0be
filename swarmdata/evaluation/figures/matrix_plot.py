"""Matrices of numbers, colored by their difference to a reference: blue is better, orange worse."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from swarmdata.drawing.style import GRAY, INK, PAGE_WIDTH, figure, words_of
from swarmdata.evaluation.figures.dot_plot import LOWEST_ROW, SCREEN_HEIGHT

WORSE, SAME, BETTER = "#B35806", "#F4F4F4", "#2166AC"  # safe for color-blind readers

LEAST_CONTRAST = 0.6  # of the scale, from where letters are white

ROW, GAP = 0.19, 0.3  # inches: height of a row; space between two groups, in rows or columns

WIDEST_COLUMN = 0.62  # inches
SCALE_WIDTH = 1.5  # inches, of the color bar
LETTER = 0.058  # inches: width of a letter of 7 points


class MatrixCell(NamedTuple):
    """A number of a matrix."""

    value: float  # in shown units
    change: float  # difference to the reference; its color
    is_framed: bool = False  # whether it has a frame and bold letters


Groups = Mapping[str, Sequence[str]]  # title -> keys of rows or columns, in their order


class Notes(NamedTuple):
    """What a matrix says about itself."""

    limit: float  # difference at which colors end
    scale: str  # what the colors show
    below: str = ""  # a line on frames and on what is absent
    colors: Mapping[str, str] = {}  # title of a group of columns -> color of its bar
    side: Mapping[str, float] = {}  # key of a row -> number beside its name
    side_title: str = ""  # of those numbers


def plot_matrix(
    cells: Mapping[tuple[str, str], MatrixCell],
    rows: Groups,
    columns: Groups,
    path: Path,
    notes: Notes,
) -> None:
    """Draws a matrix of cells by row and column with a color bar; what is absent is a dot.

    Rows are from the top; of a column's key `group: name`, only the name is shown.
    """
    from matplotlib.colors import LinearSegmentedColormap  # noqa: PLC0415  (an extra)

    scale = LinearSegmentedColormap.from_list("change", (WORSE, SAME, BETTER))
    size = _layout(rows, columns, notes)
    with figure(path, width=size.width, height=size.height) as drawing:
        drawing.set_layout_engine("none")
        axes = drawing.add_axes((0.0, 0.0, 1.0, 1.0), frameon=False, xticks=[], yticks=[])
        right = size.width - size.left
        axes.set_xlim(-size.left / size.column, right / size.column)
        axes.set_ylim(size.n_rows + size.below / size.row, -size.above / size.row)
        for name, y in size.ys.items():
            for key, x in size.xs.items():
                if (name, key) in cells:
                    _draw_cell(axes, x, y, cells[name, key], scale, notes.limit, size.font)
                else:
                    _write(axes, x + 0.5, y + 0.5, "·", color=GRAY)
        _name_rows(axes, size, notes)
        _name_columns(axes, columns, size, notes)
        _draw_scale(axes, scale, size, notes)


class _Layout(NamedTuple):
    """Inches: sizes of a row and a column, what is beside the cells, the figure; and places."""

    row: float
    column: float
    left: float
    above: float
    below: float
    width: float
    height: float
    n_rows: float  # with the gaps between groups
    ys: Mapping[str, float]  # in rows
    xs: Mapping[str, float]  # in columns

    @property
    def font(self) -> float:
        """Points of a number: four characters fill a column."""
        return min(7.0, 28.0 * self.column)


def _layout(rows: Groups, columns: Groups, notes: Notes) -> _Layout:
    ys, xs = _places(rows), _places(columns)
    left = LETTER * max(len(words_of(name)) for name in ys) + 0.15 + 0.35 * bool(notes.side)
    lean = 0.72 * LETTER * max(len(_name(key)) for key in xs)
    span, n_rows = max(xs.values()) + 1.0, max(ys.values()) + 1.0
    column = min(WIDEST_COLUMN, (PAGE_WIDTH - left - lean) / span)
    above, below = lean + 0.25, 0.62 + 0.17 * bool(notes.below) + 0.36 * any(columns)
    row = min(ROW, max(LOWEST_ROW, (SCREEN_HEIGHT - above - below) / n_rows))
    words = max(SCALE_WIDTH + 0.2 + LETTER * len(notes.scale), LETTER * len(notes.below)) + 0.2
    width = max(left + column * span + lean, words)
    height = row * n_rows + above + below
    return _Layout(row, column, left, above, below, width, height, n_rows, ys, xs)


def _name(key: str) -> str:
    return words_of(key.rpartition(": ")[2])


def _places(groups: Groups) -> dict[str, float]:
    """Where each key begins; between groups is a gap."""
    places, at = {}, 0.0
    for k, keys in enumerate(groups.values()):
        at += GAP * (k > 0)
        for key in keys:
            places[key] = at
            at += 1.0
    return places


def _write(axes: Any, x: float, y: float, text: str, **look: Any) -> None:
    axes.text(x, y, text, **{"ha": "center", "va": "center", "fontsize": 7, **look})


def _draw_cell(
    axes: Any, x: float, y: float, cell: MatrixCell, scale: Any, limit: float, font: float
) -> None:
    from matplotlib.patches import Rectangle  # noqa: PLC0415  (matplotlib is an extra)

    shade = max(-1.0, min(1.0, cell.change / limit))
    edge = INK if cell.is_framed else "none"
    box = Rectangle((x + 0.04, y + 0.06), 0.92, 0.88, fc=scale(0.5 + shade / 2), ec=edge, lw=1.2)
    axes.add_patch(box)
    color = "white" if abs(shade) > LEAST_CONTRAST else INK
    weight = "bold" if cell.is_framed else "normal"
    look = {"color": color, "fontweight": weight, "fontsize": font}
    _write(axes, x + 0.5, y + 0.52, number(cell.value), **look)


def number(value: float) -> str:
    """A whole number with a minus sign, and no minus before 0."""
    return f"{round(value)}".replace("-", "−")


def _name_rows(axes: Any, size: _Layout, notes: Notes) -> None:
    edge, room = -0.06 / size.column, 0.35 / size.column * bool(notes.side)
    for name, y in size.ys.items():
        _write(axes, edge - room, y + 0.5, words_of(name), ha="right")
        if name in notes.side:
            _write(axes, edge, y + 0.5, number(notes.side[name]), ha="right", color=GRAY)
    if notes.side:
        _write(axes, edge, -0.3, notes.side_title, ha="right", va="bottom", color=GRAY)


def _name_columns(axes: Any, columns: Groups, size: _Layout, notes: Notes) -> None:
    """Names above columns; titles of groups below them, on two heights in turn."""
    lean = {"rotation": 45, "rotation_mode": "anchor", "ha": "left", "va": "bottom"}
    for k, (title, keys) in enumerate(columns.items()):
        for key in keys:
            _write(axes, size.xs[key] + 0.4, -0.15, _name(key), **lean)
        if title:
            ends = size.xs[keys[0]] + 0.04, size.xs[keys[-1]] + 0.96
            look = {"color": notes.colors.get(title, GRAY), "lw": 2.5, "solid_capstyle": "butt"}
            axes.plot(ends, [size.n_rows + 0.05 / size.row] * 2, **look)
            below = size.n_rows + (0.09 + 0.13 * (k % 2)) / size.row
            _write(axes, sum(ends) / 2, below, title, va="top")


def _draw_scale(axes: Any, scale: Any, size: _Layout, notes: Notes) -> None:
    from matplotlib.patches import Rectangle  # noqa: PLC0415  (matplotlib is an extra)

    note = 0.17 * bool(notes.below)
    left, top = (0.1 - size.left) / size.column, size.n_rows + (size.below - 0.36 - note) / size.row
    n, width = 60, SCALE_WIDTH / size.column
    for k in range(n):
        box = (left + k * width / n, top), width / n * 1.05, 0.11 / size.row
        axes.add_patch(Rectangle(*box, fc=scale((k + 0.5) / n), lw=0))
    limit, ticks = number(notes.limit), top + 0.14 / size.row
    ends = (0.0, f"−{limit}", "left"), (0.5, "0", "center"), (1.0, f"+{limit}", "right")
    for at, text, ha in ends:
        _write(axes, left + at * width, ticks, text, va="top", ha=ha)
    beside = left + width + 0.1 / size.column
    _write(axes, beside, top + 0.06 / size.row, notes.scale, ha="left")
    if notes.below:
        _write(axes, left, top + 0.36 / size.row, notes.below, ha="left", color=GRAY)
