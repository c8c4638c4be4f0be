"""The picture of a card: what was achieved, where robots were and how they drove, on one sheet."""

from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.analysis.coverage import places_of, sample_steps
from swarmdata.cards.pictures.panels import (
    choose_episodes,
    draw_actions,
    draw_episode_paths,
    draw_lengths,
    draw_places,
    draw_returns,
    draw_rows,
    finish,
)
from swarmdata.datasets.dataset import Dataset
from swarmdata.drawing.style import GRAY, figure
from swarmdata.envs.render.canvas import pillow
from swarmdata.errors import SchemaError
from swarmdata.specs.origins import Spec
from swarmdata.specs.spaces import bounds
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Float

WIDTH, HEIGHT = 10.0, 6.25  # inches of the sheet; 1600 x 1000 pixels

RECORDED_HEIGHT = 3.6  # inches of the sheet of a recording of another environment

MAX_PICTURE_BYTES = 120_000  # of the file, so that a hundred cards weigh little

PALETTE_SIZES = (256, 192, 128, 96, 64, 48)  # colors; the most with which the file is small enough

N_SAMPLED_STEPS = 20_000  # joint steps whose actions are counted

MAX_ACTION_ROWS = 40  # columns of actions that are shown; of more, evenly spread ones

N_ACTION_BINS = 36

PATH_KEY = "○ start   ·   robot: end   ·   its color: its path and target"  # of the episodes below

PICTURE_PURPOSE = "drawing a card's picture (`swarmdata card --no-pictures` leaves it out)"


def draw_card(dataset: Dataset, path: Path) -> None:
    """Draws a dataset on one sheet, a `.png` file, whose folder is made if absent.

    Everything over time comes from samples, so a gigabyte takes as long as a mini.

    Raises:
        SchemaError: another kind of file, or a dataset without episodes.
        MissingExtraError: matplotlib or Pillow is not installed.
    """
    if path.suffix.lower() != ".png":
        raise SchemaError(f"cannot draw to {str(path)!r}, expected a file that ends in '.png'.")
    spec = dataset.recipe.spec
    height = HEIGHT if spec.world is not None else RECORDED_HEIGHT
    path.parent.mkdir(parents=True, exist_ok=True)
    size: Any = {"width": WIDTH, "height": height}
    with figure(path, **size, purpose=PICTURE_PURPOSE, medium="screen") as sheet:
        sheet.get_layout_engine().set(w_pad=0.07, h_pad=0.05, wspace=0.02, hspace=0.02)
        if spec.world is not None:
            _draw_episodes(sheet, dataset, spec.world)
        else:
            _draw_recorded(sheet, dataset, spec)
    _reduce(path)


def _draw_episodes(sheet: Any, dataset: Dataset, spec: TaskSpec) -> None:
    table, recipe = dataset.episodes, dataset.recipe
    places, _ = places_of(dataset.stored, dataset.selection)
    steps, _ = sample_steps(dataset.stored.table, dataset.selection, N_SAMPLED_STEPS)
    head, above, below = sheet.subfigures(3, 1, height_ratios=(0.5, 2.95, 2.8))
    made_by = len(np.unique(table.policy))
    made = f"{made_by} {'policy' if made_by == 1 else 'policies'}"
    _write_head(head, dataset, "robots", made, f"success {100 * table.success.mean():.0f} %")
    head.text(0.988, 0.12, PATH_KEY, fontsize=8, color=GRAY, ha="right", va="center")
    axes = above.subplots(1, 4, width_ratios=(1.15, 0.95, 1.15, 1.0))
    draw_returns(axes[0], table, recipe)
    draw_lengths(axes[1], table, spec.horizon, f"joint steps of {spec.control_dt:g} s")
    draw_places(axes[2], places, spec)
    draw_actions(axes[3], dataset.stored.arrays["actions"][steps][..., :2], spec)
    panels = below.subplots(1, 4)
    for panel, index in zip(panels, choose_episodes(table), strict=True):
        draw_episode_paths(panel, None if index is None else dataset[index], recipe)


def _draw_recorded(sheet: Any, dataset: Dataset, spec: Spec) -> None:
    table, stored = dataset.episodes, dataset.stored
    steps, states = sample_steps(stored.table, dataset.selection, N_SAMPLED_STEPS)
    acting = np.ones((len(steps), spec.n_agents), np.bool_)
    if "alive" in stored.arrays:
        acting = stored.arrays["alive"][states]
    head, panels = sheet.subfigures(2, 1, height_ratios=(0.5, 3.1))
    _write_head(head, dataset, "agents", *(f"{name}: {value}" for name, value in spec.facts[:1]))
    axes = panels.subplots(1, 3, width_ratios=(1.1, 0.9, 1.3))
    draw_returns(axes[0], table, dataset.recipe)
    draw_lengths(axes[1], table, spec.horizon or int(table.lengths.max()), "joint steps")
    draw_choices(axes[2], stored.arrays["actions"][steps], acting, spec)


def _write_head(head: Any, dataset: Dataset, who: str, *more: str) -> None:
    facts = (
        f"{dataset.recipe.spec.task} with {dataset.recipe.spec.n_agents} {who}",
        f"{dataset.n_steps:,} joint steps in {dataset.n_episodes:,} episodes",
        *more,
    )
    head.text(0.012, 0.62, dataset.id, fontsize=14, fontweight="bold", va="center")
    head.text(0.012, 0.12, "   ·   ".join(facts), fontsize=9, color=GRAY, va="center")


def draw_choices(axes: Any, actions: Float, acting: Bool, spec: Spec) -> None:
    """How often each value of each column of actions [n, N, A] was taken by who acted, [n, N]."""
    labels, shares = [], []
    for index, (name, space) in enumerate(zip(spec.agent_names, spec.action_spaces, strict=True)):
        taken = actions[acting[:, index], index]
        for column, (low, high) in enumerate(zip(*bounds(space), strict=True)):
            labels.append(f"{name} {column}")
            shares.append(_share(taken[:, column].astype(np.float64), low, high))
    n = min(len(labels), MAX_ACTION_ROWS)
    shown = np.unique(np.linspace(0, len(labels) - 1, n).astype(int))
    rows = [labels[k] for k in shown], [shares[k] for k in shown]
    draw_rows(axes, *rows, np.linspace(0, 1, N_ACTION_BINS + 1))
    finish(axes, "Actions", "from the lowest to the highest value; darker: more often")


def _share(values: Double, low: float, high: float) -> Double:
    """Shares of the values in `N_ACTION_BINS` equal bins; all 0 where nobody acted."""
    if not len(values):
        return np.full(N_ACTION_BINS, 1e-9)
    first = low if np.isfinite(low) else float(values.min())
    last = high if np.isfinite(high) else float(values.max())
    span = (last - first) or 1.0
    counts = np.histogram(np.clip((values - first) / span, 0, 1), N_ACTION_BINS, (0.0, 1.0))[0]
    share: Double = counts / len(values)
    return share


def _reduce(path: Path) -> None:
    """Rewrites a picture with a palette: a third of the bytes, and hardly a visible difference."""
    pil = pillow()
    with pil.open(path) as file:
        full = file.convert("RGB")
    for n_colors in PALETTE_SIZES:
        reduced = full.quantize(
            n_colors, method=pil.Quantize.MAXCOVERAGE, kmeans=2, dither=pil.Dither.NONE
        )
        # the lightest color becomes white: the means of paper and floor are not quite
        palette = np.array(reduced.getpalette()).reshape(-1, 3)
        palette[palette.sum(axis=1).argmax()] = 255
        reduced.putpalette(palette.ravel().tolist())
        reduced.save(path, format="PNG", optimize=True)
        if path.stat().st_size <= MAX_PICTURE_BYTES:
            return
