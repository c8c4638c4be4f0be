"""The panels below in a card's picture: recorded episodes with obstacles, starts, goals, paths."""

from typing import Any

import numpy as np

from swarmdata.cards.panels import SMALL, finish, note
from swarmdata.envs.render import ROBOT_COLORS, draw
from swarmdata.envs.render.canvas import WALL_SHOWN
from swarmdata.figures import GRAY
from swarmdata.spec import Recipe
from swarmdata.states import X, Y, robots_of
from swarmdata.store import EpisodeTable
from swarmdata.types import END_REASONS, Episode

N_TRACKS = 4

_SIZE = 380  # pixels of a drawn arena's longer side


def choose_episodes(table: EpisodeTable, n: int = N_TRACKS) -> list[int | None]:
    """Chooses episodes that stand for the rest: of different policies, from all over their returns.

    The policies, evenly spread if there are more than places, share the places in turn; the
    episodes of a policy with m places are those at the middle of m equal parts of its episodes,
    sorted by return. So one place is the median.

    Returns:
        n indices into the table, None where there are fewer episodes.
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


def draw_track(axes: Any, episode: Episode | None, recipe: Recipe) -> None:
    """Draws the last state of an episode with whole paths; rings show where robots started."""
    if episode is None:
        note(axes, "no further episode")
        return
    spec, last = recipe.spec, len(episode)
    image = draw(
        spec,
        episode.layout,
        episode.states[last],
        trails=episode.states,
        events=episode.events[last - 1],
        size=_SIZE,
    )
    x, y = spec.arena.width / 2 + WALL_SHOWN, spec.arena.height / 2 + WALL_SHOWN
    axes.imshow(image, extent=(-x, x, -y, y), interpolation="antialiased")
    starts = robots_of(episode.states[:1], spec.n_agents)[0]
    for k, row in enumerate(starts):
        color = [value / 255 for value in ROBOT_COLORS[k % len(ROBOT_COLORS)]]
        axes.plot(row[X], row[Y], "o", mfc="white", mec=color, mew=1.3, ms=4.5)
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)
    finish(axes, recipe.policies[episode.policy].label)
    axes.set_xlabel(
        f"{END_REASONS[episode.end_reason]} after {last * spec.control_dt:.1f} s, "
        f"return {episode.team_return:.2f}",
        fontsize=SMALL,
        color=GRAY,
        labelpad=2,
    )
