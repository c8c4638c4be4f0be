"""How deep bodies overlap, how fast and Markov robots in contact are: docs/measurements.md.

    python -m tests.benchmarks.bench_contacts [SECTION ...]

Sections: today recorded. `today` measures the tasks under three teams, `recorded` the deepest
overlaps and highest speeds of published datasets (which it builds if need be).
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import sys
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from swarmdata.envs.physics.backend import Contacts, Plan
from swarmdata.envs.physics.dynamics import limits_of
from swarmdata.envs.physics.episode_bodies import payload_rows
from swarmdata.envs.physics.public_backend import PublicBackend
from swarmdata.envs.transport.payload import place_row, shape_of
from swarmdata.hub.catalog.catalog import load
from swarmdata.interfaces import Policy, VecEnv
from swarmdata.numerics.geometry import clearance, nearest
from swarmdata.registry.components import TASKS, make_env, make_policy, make_task
from swarmdata.registry.presets import preset
from swarmdata.registry.recipes import checkpoints
from swarmdata.rollouts.rollout import rollout
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import BODY, N_COLUMNS, VX, VY, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Episode, Float, Step
from tests.benchmarks.measuring import table, write_section

TEAMS = ("random", "scripted", "expert")
RECORDED = (
    "coop_nav-random-mini",
    "coop_nav-n8-random-mini",
    "formation-random-mini",
    "formation-n8-medium-mini",
    "transport-medium-mini",
    "transport-medium-replay-mini",
    "warehouse-random-mini",
    "warehouse-medium-mini",
    "warehouse-medium-replay-mini",
    "warehouse-expert-mini",
)

N_EPISODES = 192
N_COPIES = 64
N_REPLAYS = 2000
"""Steps that are done again from their state alone, at most."""

Summary = tuple[float, float, float]
"""Median, 99.9 % quantile and largest value."""


class Figures(NamedTuple):
    """What was measured of some episodes."""

    free: float  # share of control steps that ended in free motion
    touching: float  # share of robot states that overlap something
    robots: Double  # depths of overlaps of two robots, m
    static: Double  # of a robot and an obstacle or wall
    payload: Double  # of a robot and the payload
    excess: Double  # speed / max_speed - 1 of robots in contact, where above 0
    deviation: Double  # of the state after a step with contact, done again from the state alone, m


def team(name: str, spec: TaskSpec, task: str) -> Policy:
    """A team: a scripted policy, or the first of the shipped experts without noise."""
    if name != "expert":
        return make_policy(name, spec)
    shipped = checkpoints(task, "expert")[0]
    return make_policy("learned", spec, checkpoint=shipped.file, sha256=shipped.sha256)


@kernel
def overlaps(
    places: Double, rows: Float, layout: Float, radii: Double, half: Double, out: Double
) -> None:
    """Writes depths (m, negative for gaps) of one state: to robots, static things, the payload.

    Args:
        places: [N, 2].
        rows: the payload as a row of a layout, [0 or 1, 8].
        layout: [M, 8].
        radii: [N].
        half: of the arena, [2].
        out: written, the deepest of each kind, [N, 3].
    """
    out[:] = -np.inf
    for i in range(radii.shape[0]):
        x, y = places[i, 0], places[i, 1]
        for j in range(radii.shape[0]):
            if j != i:
                gap = np.hypot(places[j, 0] - x, places[j, 1] - y) - radii[i] - radii[j]
                out[i, 0] = max(out[i, 0], -gap)
        out[i, 1] = radii[i] - clearance(x, y, layout, half)
        for row in rows:
            out[i, 2] = max(out[i, 2], radii[i] - nearest(x, y, row)[0])


def depths(episode: Episode, spec: TaskSpec) -> Double:
    """Depths of every state of an episode, [T + 1, N, 3]."""
    n, movables = spec.n_agents, make_task(spec).movables
    radii, half = np.array([robot.radius for robot in spec.robots]), np.array(spec.half_size)
    places = robots_of(episode.states, n)[..., :2].astype(np.float64)
    rows = np.zeros((len(movables), 8), np.float32)
    out = np.zeros((len(places), n, 3))
    for t, state in enumerate(episode.states):
        for payload in movables:
            place_row(state[N_COLUMNS * n :], shape_of(payload), rows[0])
        overlaps(places[t], rows, episode.layout, radii, half, out[t])
    return out


def again(episode: Episode, spec: TaskSpec, t: int) -> Float:
    """Positions after step t, [N, 2], in a new world that begins in its state."""
    task, n = make_task(spec), spec.n_agents
    plan = Plan(spec, task.kinds, task.movables)
    backend = PublicBackend(plan, 1)
    state = episode.states[t : t + 1]
    first, last = N_COLUMNS * n, N_COLUMNS * n + len(BODY) * len(task.movables)
    robots = state[:, :first].reshape(1, n, N_COLUMNS)[..., :6].astype(np.float64)
    bodies = state[:, first:last].reshape(1, -1, len(BODY)).astype(np.float64)
    backend.reset(
        np.zeros(1, np.int64), episode.layout[None], robots, bodies, limits_of(spec),
        payload_rows(task.movables),
    )  # fmt: skip
    commands = episode.actions[t, :, :2].astype(np.float64)
    if spec.robots[0].dynamics == "holonomic":
        commands /= np.maximum(np.hypot(*commands.T), 1.0)[:, None]
    contacts = Contacts(
        np.zeros((1, n, n), np.bool_),
        np.zeros((1, n, len(episode.layout) + 4), np.bool_),
        np.zeros((1, n, 3)),
    )
    reached, events = state.copy(), np.zeros((1, n, 4), np.uint8)
    backend.step(np.ones(1, np.bool_), commands[None], contacts, events, reached)
    return robots_of(reached[0], n)[:, :2]


def deviations(episode: Episode, spec: TaskSpec, most: int) -> list[float]:
    """Largest differences of positions, m, of steps that follow a contact, done again."""
    touched = (episode.events[:-1, :, :2] > 0).any(axis=(1, 2))
    found = []
    for t in (np.flatnonzero(touched) + 1)[:most].tolist():
        reached = robots_of(episode.states[t + 1], spec.n_agents)[:, :2]
        found.append(float(np.abs(reached - again(episode, spec, t)).max()))
    return found


def counted_free_motion(env: VecEnv) -> list[float]:
    """Makes an environment note, after each step, the share of its copies in free motion."""
    shares: list[float] = []
    step, backend = env.step, env._blocks[0]._world._backend  # type: ignore[attr-defined]  # of no user's use

    def counted(actions: Float | Double) -> Step:
        taken = step(actions)
        shares.append(float((backend.spaces.solver_dt <= 0.0).mean()))
        return taken

    env.step = counted  # type: ignore[method-assign]
    return shares


def measure(task: str, name: str, n_replays: int, n_episodes: int) -> Figures:
    """Plays a team in the task's headline preset."""
    spec = preset(task)
    top = np.array([robot.max_speed for robot in spec.robots])
    found: list[Double] = []
    excess: list[Double] = []
    deviation: list[float] = []
    env = make_env(spec, min(N_COPIES, n_episodes))
    free = counted_free_motion(env)
    seeds = np.arange(n_episodes, dtype=np.uint64)
    for episode in rollout(env, team(name, spec, task), seeds):
        deep = depths(episode, spec)
        found.append(deep.reshape(-1, 3))
        teams = robots_of(episode.states, spec.n_agents).astype(np.float64)
        speed = np.hypot(teams[..., VX], teams[..., VY]) / top - 1.0
        excess.append(speed[(deep > 0).any(-1)])
        deviation += deviations(episode, spec, n_replays - len(deviation))
    deep = np.concatenate(found)
    over = np.concatenate(excess)
    robots, static, payload = (column[column > 0] for column in deep.T)
    return Figures(
        free=float(np.mean(free)),
        touching=float((deep > 0).any(-1).mean()),
        robots=robots,
        static=static,
        payload=payload,
        excess=over[over > 1e-6],
        deviation=np.array(deviation),
    )


def summary(values: Sequence[float] | Double) -> Summary | None:
    """Quantiles, None of nothing."""
    if not len(values):
        return None
    median, high, top = np.quantile(values, [0.5, 0.999, 1.0])
    return float(median), float(high), float(top)


def shown(values: Sequence[float] | Double, scale: float) -> str:
    """Quantiles as text."""
    found = summary(values)
    return "—" if found is None else " / ".join(f"{scale * value:.2g}" for value in found)


def today_section() -> None:
    """Every task under three teams."""
    rows: list[tuple[str, ...]] = []
    for task in TASKS:
        for name in TEAMS:
            f = measure(task, name, N_REPLAYS, N_EPISODES)
            shares = f"{100 * f.free:.3g} %", f"{100 * f.touching:.2g} %"
            depths_mm = (shown(each, 1e3) for each in (f.robots, f.static, f.payload))
            excess, deviation = shown(f.excess, 100), shown(f.deviation, 1e3)
            rows.append((task, name, *shares, *depths_mm, excess, deviation))
            print(" | ".join(rows[-1]), flush=True)
    head = (
        "task", "team", "free motion", "robot states that overlap", "robots, mm",
        "obstacles and walls, mm", "payload, mm", "over max_speed in contact, %",
        "not Markov, mm",
    )  # fmt: skip
    write_section(
        "Contacts",
        "Share of steps that end in free motion; depth of overlaps in recorded states; by how much "
        "robots in contact exceed `max_speed`; and how far the state is from Markov: a step that "
        "follows a contact is simulated again from its state in a new world, and the largest "
        "difference of a coordinate is shown. The last five: median / 99.9 % / largest, "
        f"{N_EPISODES} episodes.\n\n" + table(head, rows),
    )


def recorded_section() -> None:
    """The extremes of published datasets."""
    rows: list[tuple[str, ...]] = []
    for name in RECORDED:
        dataset = load(name, progress=False)
        spec = dataset.task
        top, fastest = np.array([robot.max_speed for robot in spec.robots]), 0.0
        deepest = np.full(3, -np.inf)
        for episode in dataset:
            deepest = np.maximum(deepest, depths(episode, spec).max(axis=(0, 1)))
            robots = robots_of(episode.states, spec.n_agents).astype(np.float64)
            speed = np.hypot(robots[..., VX], robots[..., VY]) / top - 1.0
            fastest = max(fastest, float(speed.max()))
        cells = ("—" if depth <= 0 else f"{1e3 * depth:.1f}" for depth in deepest.tolist())
        rows.append((name, *cells, f"{100 * fastest:.1f}"))
        print(" | ".join(rows[-1]), flush=True)
    head = ("dataset", "robots, mm", "obstacles and walls, mm", "payload, mm", "over max_speed, %")
    write_section(
        "Contacts in datasets",
        "The deepest overlap of each kind in a recorded state, and the largest excess over "
        "`max_speed`.\n\n" + table(head, rows),
    )


SECTIONS: dict[str, Callable[[], None]] = {
    "today": today_section,
    "recorded": recorded_section,
}


def main() -> None:
    """Measures the sections named on the command line, all by default."""
    for name in sys.argv[1:] or SECTIONS:
        print(f"== {name}", flush=True)
        SECTIONS[name]()


if __name__ == "__main__":
    main()
