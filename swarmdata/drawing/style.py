"""The style of every figure: colors, fonts, and how a figure is made and saved."""

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from swarmdata.errors import SchemaError
from swarmdata.runtime.atomic import staged
from swarmdata.runtime.extras import require_extra

COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#785E3C")
"""From Okabe and Ito, "Color Universal Design", 2008; robots are drawn in the same colors."""

INK, GRAY, FAINT = "#2D333C", "#7A818B", "#E3E5E8"  # of text, background and grid

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">", "p", "h", "d")  # of points of a color

DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)))  # of lines that share a color

DATA_LINE: Mapping[str, Any] = {"color": INK, "lw": 1.0, "ls": (0, (4, 2))}
"""The mean of a dataset's own episodes, in every figure that shows it."""

FAMILY_COLORS = {
    "cloning": COLORS[0],
    "actor-critic": COLORS[1],
    "in-sample": COLORS[2],
    "conservative": COLORS[3],
    "value decomposition": COLORS[4],
    "generative": COLORS[5],
    "ablations": GRAY,
}
"""Of the families of algorithms, alike in all figures."""

SPARE_COLORS = ("#D55E00", "#8A7F00", "#7B4BA8")  # of other families, unlike those above

FAMILY_OF = {
    **dict.fromkeys(("bc", "filtered_bc", "dagger"), "cloning"),
    **dict.fromkeys(("maddpg_bc", "facmac_bc", "mappo", "maddpg", "matd3"), "actor-critic"),
    **dict.fromkeys(("iql", "omiga", "iql_cost"), "in-sample"),
    **dict.fromkeys(("cfcql", "omar", "icql_qs", "maddpg_cql"), "conservative"),
    **dict.fromkeys(("vdn", "qmix"), "value decomposition"),
    **dict.fromkeys(("mac_flow", "bc_flow", "bc_latent", "oryx"), "generative"),
}
"""Algorithm -> family. An algorithm's place in its family is its marker, in all figures."""

WORDS = {
    "-(\\d+)x$": ", \\1 × updates",
    "-without$": " ablated",
    "-gru$": ", recurrent",
    "-sets$": ", deep sets",
    "-soft$": ", soft",
    "-sharp$": ", sharp",
    "-fast": ", fast critics",
    "-safe$": ", safe rewards",
    "-decentralized$": ", local critics",
    "-team(?=$|, )": ", team reward",
    "-constant$": ", constant rate",
    "-(128|256)$": ", \\1 units",
    "^told-": "relay, ",
    "^recorded$": "as recorded",
}
"""Parts of labels in committed studies -> words, as patterns of `re.sub`."""

COLUMN_WIDTH, PAGE_WIDTH = 3.4, 7.0  # inches: of a column and of a page's text, as in papers

Medium = Literal["paper", "screen"]  # a column of a paper, or a sheet to look at on a screen

_PAPER = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "legend.fontsize": 7,
    "pdf.fonttype": 42,  # TrueType: publishers refuse Type 3 fonts
}
_SCREEN = {"font.size": 10, "axes.titlesize": 10}
DPI: Mapping[Medium, int] = {"paper": 200, "screen": 160}

_DATELESS: Mapping[str, Mapping[str, None]] = {
    ".png": {},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}
"""Suffix -> metadata without which the same figure is the same file."""

SUFFIXES = tuple(_DATELESS)

_STYLE = {
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
    "svg.hashsalt": "swarmdata",  # the same file for the same figure
}


def line_style(k: int) -> dict[str, Any]:
    """Color and dashes of line k: the dashes change once the colors repeat."""
    return {"color": COLORS[k % len(COLORS)], "ls": DASHES[(k // len(COLORS)) % len(DASHES)]}


def words_of(label: str) -> str:
    """A label of a study in words: `bc-4x` is `bc, 4 × updates`."""
    for ending, words in WORDS.items():
        label = re.sub(ending, words, label)
    return label


def words_of_pair(one: str, other: str) -> str:
    """A difference of two labels in words; what both begin with is said once."""
    first, second = words_of(one), words_of(other)
    if second == f"{first} ablated":
        return f"{first} − ablated"
    stem, _, rest = first.rpartition(", ")
    if stem and second.startswith(f"{stem}, "):
        last = second.removeprefix(f"{stem}, ")
        return f"{stem}: {rest.removesuffix(' updates')} − {last}"
    return f"{first} − {second}"


def family_name(kind: str) -> str:
    """The family of an algorithm, or that which a family is a variant of, as far as it is known."""
    plain = kind.removeprefix("recurrent ").partition(" with ")[0]
    return FAMILY_OF.get(kind, plain if plain in FAMILY_COLORS else kind)


def family_looks(families: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Returns a color and a marker of each label: of its family, and of its algorithm.

    A label that is an algorithm has that algorithm's marker; others have the next free ones of
    their color, in their order. With more families than colors, families share a color.
    """
    kinds = {label: family_name(kind) for label, kind in families.items()}
    color_of = family_colors(tuple(dict.fromkeys(kinds.values())))
    taken: dict[str, list[str]] = {}
    markers = {}
    for label in sorted(families, key=lambda name: name not in FAMILY_OF):
        used = taken.setdefault(color_of[kinds[label]], [])
        members = [k for k, family in FAMILY_OF.items() if family == FAMILY_OF.get(label)]
        wanted = [MARKERS[members.index(label)]] if members else []
        free = [each for each in (*wanted, *MARKERS) if each not in used]
        markers[label] = free[0] if free else MARKERS[len(used) % len(MARKERS)]
        used.append(markers[label])
    return {
        label: {"color": color_of[kind], "marker": markers[label]} for label, kind in kinds.items()
    }


def family_colors(kinds: Sequence[str]) -> dict[str, str]:
    """The color of each family: known ones have theirs, others the first free one."""
    found = {
        kind: FAMILY_COLORS[name] for kind in kinds if (name := family_name(kind)) in FAMILY_COLORS
    }
    for k, kind in enumerate(kinds):
        free = [color for color in (*SPARE_COLORS, *COLORS) if color not in found.values()]
        found.setdefault(kind, free[0] if free else COLORS[k % len(COLORS)])
    return found


def line_looks(looks: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, Any]]:
    """Returns each label's color, as of `family_looks`, and dashes, which differ within a color."""
    counts: Counter[str] = Counter()
    found = {}
    for label, look in looks.items():
        color = look["color"]
        found[label] = {"color": color, "ls": DASHES[counts[color] % len(DASHES)]}
        counts[color] += 1
    return found


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


def draw_legend(drawing: Any, handles: Sequence[Any]) -> None:
    """Puts a legend above all panels, in as many columns as fit into the figure's width.

    Rows after the first make the figure taller, so that panels keep their height.
    """
    if not handles:
        return
    widths = [4.2 * len(handle.get_label()) + 32 for handle in handles]  # points, at 7 points
    columns = len(handles)
    while columns > 1 and _width_of(widths, columns) > 72 * drawing.get_figwidth():
        columns -= 1
    n_rows = math.ceil(len(handles) / columns)
    columns = math.ceil(len(handles) / n_rows)  # as even as possible
    drawing.set_figheight(drawing.get_figheight() + 0.15 * (n_rows - 1))
    drawing.legend(
        handles=handles,
        loc="outside upper center",
        ncols=columns,
        handlelength=2.2,
        handletextpad=0.5,
        columnspacing=1.2,
        borderpad=0.1,
    )


def _width_of(widths: Sequence[float], n_columns: int) -> float:
    """The width of a legend, whose columns are filled one after the other, the first ones more."""
    n_short, n_tall = divmod(len(widths), n_columns)
    sizes = [n_short + 1] * n_tall + [n_short] * (n_columns - n_tall)
    starts = [sum(sizes[:k]) for k in range(n_columns)]
    return sum(max(widths[k : k + n]) for k, n in zip(starts, sizes, strict=True))


@contextmanager
def figure(
    path: Path,
    *,
    width: float,
    height: float,
    purpose: str = "drawing a figure",
    medium: Medium = "paper",
) -> Iterator[Any]:
    """Makes a figure in the project's style and saves it at the end; pyplot's state is unchanged.

    Sizes are in inches, and `purpose` is for the error message if matplotlib is missing. A PNG for
    a paper gets a PDF of the same name beside it.

    Raises:
        SchemaError: an unknown suffix.
        MissingExtraError: matplotlib is not installed.
        DiskFullError: no space was left.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise SchemaError(f"{path} has suffix {path.suffix!r}, expected one of {SUFFIXES}.")
    require_extra("matplotlib", "plots", purpose)
    import matplotlib as mpl  # noqa: PLC0415  (matplotlib is an extra)
    from matplotlib.figure import Figure  # noqa: PLC0415

    sizes = _PAPER if medium == "paper" else _SCREEN
    looks = {**mpl.rcParamsDefault, "backend": "agg", **_STYLE, **sizes}
    with mpl.rc_context(looks):
        drawing = Figure(figsize=(width, height), layout="constrained")
        yield drawing
        for file in files_of(path, medium):
            with staged(file) as target:
                drawing.savefig(target, dpi=DPI[medium], metadata=_DATELESS[file.suffix.lower()])


def files_of(path: Path, medium: Medium = "paper") -> tuple[Path, ...]:
    """The files of a figure: a PNG for a paper has a PDF beside it."""
    if medium == "paper" and path.suffix.lower() == ".png":
        return path, path.with_suffix(".pdf")
    return (path,)
