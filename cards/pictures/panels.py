"""The panels of a card's picture: returns, lengths, places, commands, and episodes with paths."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from swarmdata.analysis.visits import Occupancy
from swarmdata.drawing.style import COLORS, FAINT, GRAY, INK, draw_grid, thousands
from swarmdata.envs.render import draw
from swarmdata.envs.render.canvas import WALL_WIDTH
from swarmdata.envs.render.colors import PAYLOAD_EDGE_COLOR, robot_color
from swarmdata.envs.render.drawn_scene import n_bodies
from swarmdata.specs.origins import Origin, task_of
from swarmdata.specs.state_layout import BODY, N_COLUMNS, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import EpisodeTable
from swarmdata.types import END_REASONS, Double, Episode, Float, Int

SMALL_FONT_SIZE = 8  # points of ticks and notes

MAX_RIDGES = 8  # policies that are shown as ridges; more become rows of a table of shades

N_RETURN_BINS = 36

N_EPISODES_SHOWN = 4  # panels

ARENA_PIXELS = 380  # longer side of a drawn arena

END_COLORS = dict(zip(END_REASONS, (COLORS[2], "#D52222", COLORS[1], COLORS[0]), strict=True))
_SOLID, _FLOOR = "#545D6A", "#FCFCFA"  # as in pictures of worlds
PLACE_SHADES = ("#E4EEF5", "#9CC7E0", "#4A9BCB", "#0072B2", "#0B3F66", "#06223A")


def signed(value: float) -> str:
    """Two decimals, with the minus sign of axes."""
    return f"{value:.2f}".replace("-", "\N{MINUS SIGN}")


def finish(axes: Any, title: str, xlabel: str = "", ylabel: str = "") -> None:
    """Writes what a panel shows, and its axes, in the sizes that all panels share."""
    axes.set_title(title, fontsize=9, fontweight="bold", loc="left")
    axes.set_xlabel(xlabel, fontsize=SMALL_FONT_SIZE)
    axes.set_ylabel(ylabel, fontsize=SMALL_FONT_SIZE)
    axes.tick_params(labelsize=SMALL_FONT_SIZE, length=2.5, width=0.6)


def draw_returns(axes: Any, table: EpisodeTable, recipe: Origin) -> None:
    """Distribution of the team return, a ridge for each policy with a mark at its mean."""
    labels = [source.label for source in recipe.policies]
    groups = [table.team_return[table.policy == k] for k in range(len(labels))]
    shown = [(label, group) for label, group in zip(labels, groups, strict=True) if len(group)]
    low, high = float(table.team_return.min()), float(table.team_return.max())
    margin = max(0.02 * (high - low), 1e-3) if high > low else 0.5  # short labels of a constant
    edges = np.linspace(low - margin, high + margin, N_RETURN_BINS + 1)
    shares = [np.histogram(group, edges)[0] / len(group) for _, group in shown]
    if len(shown) > MAX_RIDGES:
        draw_rows(axes, [label for label, _ in shown], shares, edges)
        finish(axes, "Team return by policy", "team return; darker: more of its episodes")
    else:
        _draw_ridges(axes, shown, shares, edges)
        finish(axes, "Team return by policy", "team return of an episode")


def _draw_ridges(
    axes: Any, groups: Sequence[tuple[str, Double]], shares: Sequence[Double], edges: Double
) -> None:
    n, peak = len(groups), max(float(share.max()) for share in shares)
    middles = (edges[:-1] + edges[1:]) / 2
    kernel = np.array([0.25, 0.5, 0.25])
    for k, ((label, group), share) in enumerate(zip(groups, shares, strict=True)):
        base, color = float(n - 1 - k), COLORS[k % len(COLORS)]
        height = base + 0.86 / peak * np.convolve(share, kernel, mode="same")
        axes.fill_between(middles, base, height, color=color, alpha=0.35, lw=0, step="mid")
        axes.step(middles, height, where="mid", color=color, lw=1.2)
        axes.axhline(base, color=FAINT, lw=0.8, zorder=0)
        mean = float(group.mean())
        axes.plot([mean, mean], [base, base + 0.86], color=INK, lw=1.0, ls=(0, (2, 1.5)))
        is_left = mean > (edges[0] + edges[-1]) / 2  # of the panel there is room
        axes.annotate(
            f"{label}\nmean {signed(mean)}",
            (0.02 if is_left else 0.98, base + 0.9),
            xycoords=("axes fraction", "data"),
            fontsize=SMALL_FONT_SIZE - 0.5 if n <= 5 else SMALL_FONT_SIZE - 2,
            color=color,
            fontweight="bold",
            va="top",
            ha="left" if is_left else "right",
            linespacing=1.1,
        )
    axes.set(xlim=(edges[0], edges[-1]), ylim=(-0.06, n), yticks=[])
    axes.spines["left"].set_visible(False)


def draw_rows(axes: Any, labels: Sequence[str], shares: Sequence[Double], edges: Double) -> None:
    """Distributions as rows of a table: the darker, the larger the share in the row."""
    table = np.stack(shares) / np.stack(shares).max(axis=1, keepdims=True)
    n = len(labels)
    look = {"cmap": _shades(from_floor=True), "interpolation": "nearest", "aspect": "auto"}
    axes.imshow(table, extent=(edges[0], edges[-1], n, 0), **look)
    shown = np.arange(0, n, -(-n // 14))
    axes.set_yticks(shown + 0.5, [labels[k] for k in shown.tolist()], fontsize=SMALL_FONT_SIZE - 2)


def draw_lengths(axes: Any, table: EpisodeTable, horizon: int, xlabel: str) -> None:
    """How long episodes were, stacked by the reason of their end."""
    edges = np.linspace(0.0, horizon, 33)
    bottom = np.zeros(32)
    for code, reason in enumerate(END_REASONS):
        lengths = table.lengths[table.end_reason == code]
        if not len(lengths):
            continue
        counts = np.histogram(lengths, edges)[0].astype(np.float64)
        label = f"{reason} {100 * len(lengths) / len(table):.0f} %"
        look = {"align": "edge", "color": END_COLORS[reason], "label": label}
        axes.bar(edges[:-1], counts, np.diff(edges), bottom, **look)
        bottom += counts
    axes.set_xlim(0.0, horizon)
    axes.set_ylim(0.0, 1.32 * bottom.max())
    axes.yaxis.set_major_formatter(thousands)
    draw_grid(axes, "y")
    axes.legend(
        fontsize=SMALL_FONT_SIZE, loc="upper left", handlelength=0.9, borderpad=0, labelspacing=0.25
    )
    finish(axes, "Length by how it ended", xlabel, "episodes")


def draw_places(axes: Any, places: Occupancy, spec: TaskSpec) -> None:
    """Visits of each cell, logarithmic; what no robot's centre can reach is solid."""
    from matplotlib.colors import ListedColormap  # noqa: PLC0415  (matplotlib is an extra)

    x, y = spec.arena.width / 2, spec.arena.height / 2
    rows, columns = places.visits.shape
    extent = (-x, columns * places.cell - x, -y, rows * places.cell - y)
    axes.set_facecolor(_SOLID)
    floor = np.where(places.free, 1.0, np.nan)
    axes.imshow(floor, origin="lower", extent=extent, cmap=ListedColormap([_FLOOR]))
    shown = _draw_counts(axes, places.visits, extent)
    axes.set(xlim=(-x, x), ylim=(-y, y))
    axes.set_anchor("N")
    for spine in axes.spines.values():
        spine.set(visible=True, color=_SOLID, linewidth=1.2)
    bar = axes.figure.colorbar(
        shown, ax=axes, shrink=0.8, aspect=24, pad=0.03, anchor=(0.0, 0.9), panchor=(0.5, 1.0)
    )
    bar.set_label("robot-steps in a cell", fontsize=SMALL_FONT_SIZE - 0.5)
    bar.ax.tick_params(labelsize=SMALL_FONT_SIZE - 1, length=2, width=0.5)
    bar.ax.minorticks_off()
    bar.ax.yaxis.set_major_formatter(thousands)
    bar.outline.set_visible(False)
    finish(axes, f"Places: {100 * places.visited:.0f} % of free cells", "x (m)", "y (m)")


def draw_actions(axes: Any, actions: Float, spec: TaskSpec) -> None:
    """Two-dimensional histogram of driving commands in [-1, 1], [n, N, 2], with its marginals."""
    kinds = {robot.dynamics for robot in spec.robots}
    names = {"holonomic": ("along x", "along y"), "unicycle": ("forward", "turn")}
    first, second = names[kinds.pop()] if len(kinds) == 1 else ("1st", "2nd")
    edges = np.linspace(-1.0, 1.0, 42)
    flat = actions.reshape(-1, 2)
    counts = np.histogram2d(flat[:, 0], flat[:, 1], bins=(edges, edges))[0].T
    _draw_counts(axes, counts, (-1, 1, -1, 1))
    middles = (edges[:-1] + edges[1:]) / 2
    look = {"color": COLORS[0], "alpha": 0.8, "lw": 0, "step": "mid"}
    for axis, fill in enumerate((axes.fill_between, axes.fill_betweenx)):
        sums = counts.sum(axis=axis)
        fill(middles, 1.04, 1.04 + 0.32 * sums / sums.max(), **look)
    axes.plot([-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1], color=_SOLID, lw=0.9)
    axes.set(xticks=(-1, 0, 1), yticks=(-1, 0, 1), xlim=(-1.02, 1.37), ylim=(-1.02, 1.37))
    axes.set_anchor("N")
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    finish(axes, "Commands", f"command {first}", f"command {second}")


def _draw_counts(axes: Any, counts: Int | Double, extent: tuple[float, ...]) -> Any:
    """Cells of a grid, the darker, the more is counted, logarithmic; empty ones are left out."""
    from matplotlib.colors import LogNorm  # noqa: PLC0415  (matplotlib is an extra)

    look = {"cmap": _shades(), "norm": LogNorm(1.0, max(10.0, float(counts.max())))}
    shown = np.where(counts > 0, counts, np.nan)
    return axes.imshow(shown, origin="lower", extent=extent, interpolation="nearest", **look)


def _shades(*, from_floor: bool = False) -> Any:
    """From light to dark blue, evenly in lightness; in gray prints as well."""
    from matplotlib.colors import LinearSegmentedColormap  # noqa: PLC0415  (an extra)

    steps = (_FLOOR, *PLACE_SHADES) if from_floor else PLACE_SHADES
    return LinearSegmentedColormap.from_list("swarmdata", steps, N=48)


def note(axes: Any, text: str) -> None:
    """One line in gray instead of a panel's content."""
    axes.text(
        0.5, 0.5, text, transform=axes.transAxes, ha="center", fontsize=SMALL_FONT_SIZE, color=GRAY
    )
    axes.axis("off")


def choose_episodes(table: EpisodeTable, n: int = N_EPISODES_SHOWN) -> list[int | None]:
    """Chooses representative episodes: of different policies, spread over their returns.

    The policies, evenly spread if there are more than places, share the n places in turn; those of
    a policy with m places are the medians of m equal parts of its episodes, sorted by return.
    Indices are None where there are fewer episodes.
    """
    policies = np.unique(table.policy)
    if len(policies) > n:
        policies = policies[np.linspace(0, len(policies) - 1, n).round().astype(np.int64)]
    places = [n // len(policies) + (k < n % len(policies)) for k in range(len(policies))]
    chosen: list[int | None] = []
    for policy, m in zip(policies.tolist(), places, strict=True):
        rows = np.flatnonzero(table.policy == policy)
        ranked = rows[np.argsort(table.team_return[rows], kind="stable")]
        at = ((np.arange(m) + 0.5) / m * len(ranked)).astype(np.int64)
        chosen += [int(ranked[k]) for k in np.unique(at)]
    return chosen + [None] * (n - len(chosen))


def draw_episode_paths(axes: Any, episode: Episode | None, recipe: Origin) -> None:
    """Draws the last state of an episode with whole paths; rings show where robots started."""
    if episode is None:
        note(axes, "no further episode")
        return
    spec, last = task_of(recipe, "a picture"), len(episode)
    events = episode.events[last - 1]
    image = draw(spec, episode.layout, episode.states[last], events=events, size=ARENA_PIXELS)
    x, y = spec.arena.width / 2 + WALL_WIDTH, spec.arena.height / 2 + WALL_WIDTH
    axes.imshow(image, extent=(-x, x, -y, y), interpolation="antialiased")
    for path, color in _paths(episode, spec):
        axes.plot(path[:, 0], path[:, 1], color=color, lw=1.1, alpha=0.7)
        axes.plot(*path[0], "o", mfc="white", mec=color, mew=1.3, ms=4.5)
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)
    finish(axes, recipe.policies[episode.policy].label)
    axes.set_xlabel(
        f"{END_REASONS[episode.end_reason]} after {last * spec.control_dt:.1f} s, "
        f"return {signed(episode.team_return)}",
        fontsize=SMALL_FONT_SIZE,
        color=GRAY,
        labelpad=2,
    )


def _paths(episode: Episode, spec: TaskSpec) -> list[tuple[Double, tuple[float, ...]]]:
    """Paths [T+1, 2] of robots and payloads with colors; NaN below a robot at its last place."""
    n = spec.n_agents
    places = robots_of(episode.states, n)[..., [X, Y]].astype(np.float64)
    colors = [robot_color(k) for k in range(n)]
    radii = np.array([robot.radius for robot in spec.robots])
    paths = []
    for k in range(n_bodies(spec)):
        first = N_COLUMNS * n + len(BODY) * k
        paths.append((episode.states[:, first : first + 2].astype(np.float64), PAYLOAD_EDGE_COLOR))
    for k in range(n):
        gaps = np.sqrt(np.square(places[:, k, None] - places[-1]).sum(axis=-1))  # [T+1, N]
        is_below = (gaps < radii).any(axis=1)
        is_below[0] = False
        paths.append((np.where(is_below[:, None], np.nan, places[:, k]), colors[k]))
    return [(path, tuple(value / 255 for value in color)) for path, color in paths]
