"""The picture of a recording of another environment: returns, lengths and actions."""

from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.analysis.coverage import sample_steps
from swarmdata.cards.pictures.panels import draw_returns, draw_rows, finish, stack_lengths
from swarmdata.datasets.dataset import Dataset
from swarmdata.drawing.style import GRAY, figure
from swarmdata.specs.origins import Spec
from swarmdata.specs.spaces import bounds
from swarmdata.types import Bool, Double, Float

WIDTH, HEIGHT = 10.0, 3.6
"""Inches of the sheet."""

N_SAMPLED_STEPS = 20_000
"""Joint steps whose actions are counted."""

MAX_ACTION_ROWS = 40
"""Columns of actions that are shown; of more, evenly spread ones."""

N_ACTION_BINS = 36


def draw_recorded(dataset: Dataset, spec: Spec, path: Path, *, purpose: str) -> None:
    """Draws a recording on one sheet.

    Args:
        dataset: what to show.
        spec: of the dataset.
        path: the `.png` file; its folder is made if absent.
        purpose: what needs matplotlib, for the error.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    table, stored = dataset.episodes, dataset.stored
    steps, states = sample_steps(stored.table, dataset.selection, N_SAMPLED_STEPS)
    acting = np.ones((len(steps), spec.n_agents), np.bool_)
    if "alive" in stored.arrays:
        acting = stored.arrays["alive"][states]
    path.parent.mkdir(parents=True, exist_ok=True)
    with figure(path, width=WIDTH, height=HEIGHT, purpose=purpose, medium="screen") as sheet:
        sheet.get_layout_engine().set(w_pad=0.07, h_pad=0.05, wspace=0.02, hspace=0.02)
        head, panels = sheet.subfigures(2, 1, height_ratios=(0.5, 3.1))
        _write_head(head, dataset, spec)
        axes = panels.subplots(1, 3, width_ratios=(1.1, 0.9, 1.3))
        draw_returns(axes[0], table, dataset.recipe)
        most = spec.horizon or int(table.lengths.max())
        stack_lengths(axes[1], table, most, "joint steps")
        draw_choices(axes[2], stored.arrays["actions"][steps], acting, spec)


def _write_head(head: Any, dataset: Dataset, spec: Spec) -> None:
    facts = (
        f"{spec.task} with {spec.n_agents} agents",
        f"{dataset.n_steps:,} joint steps in {dataset.n_episodes:,} episodes",
        *(f"{name}: {value}" for name, value in spec.facts[:1]),
    )
    head.text(0.012, 0.62, dataset.id, fontsize=14, fontweight="bold", va="center")
    head.text(0.012, 0.12, "   ·   ".join(facts), fontsize=9, color=GRAY, va="center")


def draw_choices(axes: Any, actions: Float, acting: Bool, spec: Spec) -> None:
    """How often each value of each column of an action was taken, a row for each.

    Args:
        axes: the panel.
        actions: as recorded, [n, N, A].
        acting: who took one, [n, N].
        spec: of the recording.
    """
    labels, shares = [], []
    for index, (name, space) in enumerate(zip(spec.agent_names, spec.action_spaces, strict=True)):
        taken = actions[acting[:, index], index]
        for column, (low, high) in enumerate(zip(*bounds(space), strict=True)):
            labels.append(f"{name} {column}")
            shares.append(_share(taken[:, column].astype(np.float64), low, high))
    shown = np.unique(
        np.linspace(0, len(labels) - 1, min(len(labels), MAX_ACTION_ROWS)).astype(int)
    )
    rows = [labels[k] for k in shown], [shares[k] for k in shown]
    draw_rows(axes, *rows, np.linspace(0, 1, N_ACTION_BINS + 1))
    finish(axes, "Actions", "from the lowest to the highest value; darker: more often")


def _share(values: Double, low: float, high: float) -> Double:
    """Shares of the values in equal bins of their range, [_BINS]; all 0 where nobody acted."""
    if not len(values):
        return np.full(N_ACTION_BINS, 1e-9)
    first = low if np.isfinite(low) else float(values.min())
    last = high if np.isfinite(high) else float(values.max())
    span = (last - first) or 1.0
    counts = np.histogram(np.clip((values - first) / span, 0, 1), N_ACTION_BINS, (0.0, 1.0))[0]
    share: Double = counts / len(values)
    return share
