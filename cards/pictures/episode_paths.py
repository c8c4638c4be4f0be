"""The lower panels of a card's picture: episodes with obstacles, starts, goals and paths."""

from typing import Any

import numpy as np

from swarmdata.cards.pictures.panels import SMALL_FONT_SIZE, finish, note, signed
from swarmdata.drawing.style import GRAY
from swarmdata.envs.render import draw
from swarmdata.envs.render.canvas import WALL_WIDTH
from swarmdata.envs.render.colors import PAYLOAD_EDGE_COLOR, robot_color
from swarmdata.envs.render.drawn_scene import n_bodies
from swarmdata.specs.origins import Origin, task_of
from swarmdata.specs.state_layout import BODY, N_COLUMNS, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import EpisodeTable
from swarmdata.types import END_REASONS, Double, Episode

N_EPISODES_SHOWN = 4  # panels

ARENA_PIXELS = 380  # longer side of a drawn arena


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
