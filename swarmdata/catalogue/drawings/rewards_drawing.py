"""A small drawing of an episode of another library's environment: each agent's rewards so far."""

import numpy as np

from swarmdata.catalogue.drawings import svg_shapes
from swarmdata.catalogue.drawings.estimate_chart import N_COLORS
from swarmdata.catalogue.elements import Html
from swarmdata.types import Double, Float

WIDTH, HEIGHT, MARGIN = 200.0, 130.0, 8.0
MOST_POINTS = 60
MOST_AGENTS = 12


def rewards_drawing(rewards: Float, label: str) -> Html:
    """Draws a line for each agent.

    Args:
        rewards: of an episode, [T, N].
        label: for screen readers.
    """
    shown = rewards[:, :MOST_AGENTS].astype(np.float64)
    sums = np.cumsum(np.where(np.isfinite(shown), shown, 0.0), axis=0)
    sums = np.concatenate([np.zeros_like(sums[:1]), sums])
    low, high = float(sums.min()), float(sums.max())
    rows = np.unique(np.linspace(0, len(sums) - 1, MOST_POINTS).astype(int))
    across = MARGIN + rows / max(1, len(sums) - 1) * (WIDTH - 2 * MARGIN)

    def up(values: Double) -> Double:
        return HEIGHT - MARGIN - (values - low) / (high - low or 1.0) * (HEIGHT - 2 * MARGIN)

    zero = float(up(np.zeros(1))[0])
    lines = [
        svg_shapes.path(
            list(zip(across.tolist(), up(sums[rows, i]).tolist(), strict=True)),
            class_=f"series-{i % N_COLORS}",
        )
        for i in range(sums.shape[1])
    ]
    axis = svg_shapes.line((MARGIN, zero), (WIDTH - MARGIN, zero))
    return svg_shapes.drawing(WIDTH, HEIGHT, label, axis, *lines, class_="rewards")
