"""The picture of a card: what was achieved, where robots were and how they drove, on one sheet."""

from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.analysis.coverage import places_of, sample_steps
from swarmdata.cards.pictures.episode_paths import choose_episodes, draw_episode_paths
from swarmdata.cards.pictures.panels import draw_actions, draw_lengths, draw_places, draw_returns
from swarmdata.cards.pictures.recording_sheet import draw_recorded
from swarmdata.datasets.dataset import Dataset
from swarmdata.drawing.style import GRAY, figure
from swarmdata.envs.render.canvas import pillow
from swarmdata.errors import SchemaError
from swarmdata.specs.origins import task_of

WIDTH, HEIGHT = 10.0, 6.25
"""Inches of the sheet; 1600 x 1000 pixels."""

MAX_PICTURE_BYTES = 120_000
"""Of the file, so that a hundred cards weigh little."""

PALETTE_SIZES = (256, 192, 128, 96, 64, 48)
"""Colors that the sheet is reduced to: the most with which the file has at most `MOST_BYTES`."""

N_SAMPLED_STEPS = 20_000
"""Joint steps whose commands are counted."""

PATH_KEY = "○ start   ·   robot: end   ·   its color: its path and target"
"""Of the episodes below."""

PICTURE_PURPOSE = "drawing a card's picture (`swarmdata card --no-pictures` leaves it out)"


def draw_card(dataset: Dataset, path: Path) -> None:
    """Draws a dataset on one sheet.

    Above: returns and lengths of episodes, places and commands of robots; below: four episodes.
    Of a recording of another environment: returns, lengths and actions.
    A gigabyte takes as long as a mini: everything over time comes from samples.

    Args:
        dataset: what to show.
        path: the `.png` file; its folder is made if absent.

    Raises:
        SchemaError: another kind of file, or a dataset without episodes.
        MissingExtraError: matplotlib or Pillow is not installed.
    """
    if path.suffix.lower() != ".png":
        raise SchemaError(f"cannot draw to {str(path)!r}, expected a file that ends in '.png'.")
    if dataset.recipe.spec.world is None:
        draw_recorded(dataset, dataset.recipe.spec, path, purpose=PICTURE_PURPOSE)
        _reduce(path)
        return
    table, recipe, spec = dataset.episodes, dataset.recipe, task_of(dataset.recipe, "the picture")
    places, _ = places_of(dataset.stored, dataset.selection)
    steps, _ = sample_steps(dataset.stored.table, dataset.selection, N_SAMPLED_STEPS)
    path.parent.mkdir(parents=True, exist_ok=True)
    with figure(
        path, width=WIDTH, height=HEIGHT, purpose=PICTURE_PURPOSE, medium="screen"
    ) as sheet:
        sheet.get_layout_engine().set(w_pad=0.07, h_pad=0.05, wspace=0.02, hspace=0.02)
        head, above, below = sheet.subfigures(3, 1, height_ratios=(0.5, 2.95, 2.8))
        _write_head(head, dataset)
        head.text(0.988, 0.12, PATH_KEY, fontsize=8, color=GRAY, ha="right", va="center")
        axes = above.subplots(1, 4, width_ratios=(1.15, 0.95, 1.15, 1.0))
        draw_returns(axes[0], table, recipe)
        draw_lengths(axes[1], table, spec)
        draw_places(axes[2], places, spec)
        draw_actions(axes[3], dataset.stored.arrays["actions"][steps][..., :2], spec)
        panels = below.subplots(1, 4)
        for panel, index in zip(panels, choose_episodes(table), strict=True):
            draw_episode_paths(panel, None if index is None else dataset[index], recipe)
    _reduce(path)


def _write_head(head: Any, dataset: Dataset) -> None:
    table, spec = dataset.episodes, dataset.recipe.spec
    made_by = len(np.unique(table.policy))
    facts = (
        f"{spec.task} with {spec.n_agents} robots",
        f"{dataset.n_steps:,} joint steps in {len(table):,} episodes",
        f"{made_by} {'policy' if made_by == 1 else 'policies'}",
        f"success {100 * table.success.mean():.0f} %",
    )
    head.text(0.012, 0.62, dataset.id, fontsize=14, fontweight="bold", va="center")
    head.text(0.012, 0.12, "   ·   ".join(facts), fontsize=9, color=GRAY, va="center")


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
