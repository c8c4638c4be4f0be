"""Rewards computed again from states and events, by the words of `reward_terms`, in float64.

What is written here follows the formulas as somebody would who has read them and not our code.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import permutations
from typing import Any

import numpy as np
import pytest

from swarmdata.envs.coop_nav.navigation_rules import NavigationRules
from swarmdata.envs.transport.transport_rules import TransportRewards, TransportRules
from swarmdata.interfaces import Task
from swarmdata.registry.components import make_env, reward_terms
from swarmdata.registry.presets import preset
from swarmdata.specs.rules import Payload
from swarmdata.types import EVENTS, Step
from tests.examples.read_with_zarr import distance
from tests.numerics.test_weighted_terms import plain
from tests.support.pairs import slow

Values = dict[str, Any]
"""What formulas mention, each [E, N] or wider."""


CLOSE = 1e-5
"""`store.attributes.PRECISION` says so."""


def robots(states: Any, n: int) -> Any:
    """[E, N, 8], float64."""
    return states[:, : 8 * n].reshape(len(states), n, 8).astype(float)


def own_columns(task: Task, states: Any) -> Mapping[str, Any]:
    """The columns behind robots and payloads by name, each [E, 1]."""
    first = states.shape[1] - len(task.extras)
    return {c.name: states[:, [first + k]].astype(float) for k, c in enumerate(task.extras)}


def length(vectors: Any) -> Any:
    return np.linalg.norm(vectors, axis=-1)


def common(task: Task, before: Step, now: Step) -> Values:
    """Contacts, gaps, and whether it was solved."""
    spec = task.spec
    n, radius = spec.n_agents, np.array([robot.radius for robot in spec.robots])
    p = robots(now.states, n)[..., :2]
    others = length(p[:, :, None] - p[:, None]) - radius + np.diag(np.full(n, np.inf))
    walls = (np.array([spec.arena.width, spec.arena.height]) / 2 - abs(p)).min(-1)
    gaps = np.minimum(others.min(-1), walls)
    for e, layout in enumerate(now.layouts):
        for row in layout:
            gaps[e] = np.minimum(gaps[e], distance(p[e], row))
    events = {name: now.events[..., k].astype(float) for k, name in enumerate(EVENTS)}
    return {**events, "gap": gaps - radius, "solved": now.successes[:, None]}


def navigation(task: Task, before: Step, now: Step) -> Values:
    d_old, d = (length(r[..., 6:] - r[..., :2]) for r in robots_of(task, before, now))
    return {"d_old": d_old, "d": d}


def unassigned(task: Task, before: Step, now: Step) -> Values:
    n = task.spec.n_agents
    least = []
    for state, r in zip((before.states, now.states), robots_of(task, before, now), strict=True):
        goals = state[:, 8 * n :].reshape(len(state), n, 2).astype(float)
        away = length(r[:, :, None, :2] - goals[:, None])  # [E, robots, goals]
        sums = [away[:, range(n), order].sum(-1) for order in permutations(range(n))]
        least.append(np.min(sums, axis=0)[:, None])
    is_open = (away.min(1) > task.spec.rules_as(NavigationRules).goal_radius).sum(-1, keepdims=True)
    return {"D_old": least[0], "D": least[1], "open": is_open, "N": n}


def formation(task: Task, before: Step, now: Step) -> Values:
    own = own_columns(task, now.states)
    x, y, vx, vy, _, _, tx, ty = np.moveaxis(robots_of(task, before, now)[1], -1, 0)
    r = own["reference_turn_rate"]
    slot_vx = own["reference_vx"] - r * (ty - own["reference_y"])
    slot_vy = own["reference_vy"] + r * (tx - own["reference_x"])
    return {"d": np.hypot(tx - x, ty - y), "dv": np.hypot(slot_vx - vx, slot_vy - vy)}


def transport(task: Task, before: Step, now: Step) -> Values:
    n, payload = task.spec.n_agents, task.movables[0]
    found = []
    for step, r in zip((before, now), robots_of(task, before, now), strict=True):
        x, y, _, _, ux, uy, _ = np.moveaxis(step.states[:, 8 * n : 8 * n + 7].astype(float), -1, 0)
        d = np.hypot(r[:, 0, 6] - x, r[:, 0, 7] - y)[:, None]
        is_box = float(payload.shape == "box")
        size = (payload.half_length, payload.half_width if is_box else payload.half_length)
        body = np.stack([np.full_like(x, is_box), x, y, ux, uy, *(np.full_like(x, s) for s in size),
                         np.zeros_like(x)], axis=-1)  # fmt: skip
        g = np.array([distance(r[e, :, :2], body[e]) for e in range(len(r))])
        own, s = own_columns(task, step.states), 0.0
        if own:
            s = abs(ux[:, None] * own["goal_uy"] - uy[:, None] * own["goal_ux"])
        found.append((d, s, g))
    (d_old, s_old, g_old), (d, s, g) = found
    return {"d_old": d_old, "d": d, "s_old": s_old, "s": s, "g_old": g_old, "g": g}


def warehouse(task: Task, before: Step, now: Step) -> Values:
    meaning = next(term.meaning for term in reward_terms(task) if term.name == "progress")
    words = meaning.replace("(", " ").replace(")", " ").replace(",", " ").split()
    first = float(words[words.index("u") + 4])
    pitch = float(words[words.index("floor") + 3])
    depth = float(words[words.index(">=") + 1])
    lanes = [tuple(map(float, part.split("]")[0].split(", "))) for part in meaning.split("[")[1:]]

    def corridor(y: Any) -> Any:
        u = y - first
        k = np.floor(u / pitch)
        return np.where(u < 0, 0, np.where(u - k * pitch >= depth, k + 1, -1))

    old, new = robots_of(task, before, now)
    tx, ty = old[..., 6], old[..., 7]

    def path_length(x: Any, y: Any) -> Any:
        low, high = np.minimum(x, tx), np.maximum(x, tx)
        gaps = [np.maximum(0, np.maximum(a - high, low - b)) for a, b in lanes]
        detour = np.where(corridor(y) == corridor(ty), 0, 2 * np.min(gaps, axis=0))
        return abs(tx - x) + abs(ty - y) + detour

    n = task.spec.n_agents
    mine = [step.states[:, 8 * n :].reshape(-1, n, 2) for step in (before, now)]
    return {
        "L_old": path_length(old[..., 0], old[..., 1]),
        "L": path_length(new[..., 0], new[..., 1]),
        "picked": mine[1][..., 0] > mine[0][..., 0],
        "delivered": mine[1][..., 1] > mine[0][..., 1],
    }


def intersection(task: Task, before: Step, now: Step) -> Values:
    n = task.spec.n_agents
    old, new = robots_of(task, before, now)
    target = old[..., 6:]
    mine = [step.states[:, 8 * n :].reshape(-1, n, 3) for step in (before, now)]
    return {
        "L_old": abs(target - old[..., :2]).sum(-1),
        "L": abs(target - new[..., :2]).sum(-1),
        "entered": mine[1][..., 0] > mine[0][..., 0],
        "left": mine[1][..., 1] > mine[0][..., 1],
    }


def search(task: Task, before: Step, now: Step) -> Values:
    old, new = robots_of(task, before, now)

    def columns(step: Step, *ends: str) -> Any:
        own = own_columns(task, step.states)
        chosen = [v[:, 0] for k, v in own.items() if k.rstrip("0123456789").endswith(ends)]
        return np.stack(chosen, -1)

    n = task.spec.n_agents
    known = [columns(step, ".known_").reshape(len(old), n, -1) for step in (before, now)]
    squares = [columns(step, ".searched_").reshape(len(old), n, -1) for step in (before, now)]
    rescued = [columns(step, ".rescued").sum(-1, keepdims=True) for step in (before, now)]
    return {
        "knew": (known[0] == 1).any(-1),
        "d_old": length(old[..., 6:] - old[..., :2]),
        "d": length(old[..., 6:] - new[..., :2]),
        "sighted": ((known[0] == 0) & (known[1] > 0)).sum(-1),
        "squares": (squares[1] - squares[0]).sum(-1),
        "rescued": rescued[1] - rescued[0],
    }


def pursuit(task: Task, before: Step, now: Step) -> Values:
    old, new = robots_of(task, before, now)
    n, sees_all = task.spec.n_agents, task.spec.rules.model_dump()["sight_range"] is None

    def columns(step: Step, ending: str) -> Any:
        own = own_columns(task, step.states)
        return np.stack([v[:, 0] for k, v in own.items() if k.endswith(ending)], -1)

    def knows(step: Step) -> Any:
        if sees_all:
            return (columns(step, ".captured") == 0).any(-1, keepdims=True)
        return (columns(step, "_known").reshape(len(old), n, -1) == 1).any(-1)

    captured = [columns(step, ".captured").sum(-1, keepdims=True) for step in (before, now)]
    return {
        "kept": knows(before) & knows(now) & (captured[0] == captured[1]),
        "d_old": length(old[..., 6:] - old[..., :2]),
        "d": length(new[..., 6:] - new[..., :2]),
        "captured": captured[1] - captured[0],
    }


def robots_of(task: Task, before: Step, now: Step) -> tuple[Any, Any]:
    n = task.spec.n_agents
    return robots(before.states, n), robots(now.states, n)


def tag(task: Task, before: Step, now: Step) -> Values:
    old, new = robots_of(task, before, now)
    gaps = [length(r[:, :-1, :2] - r[:, -1:, :2]) for r in (old, new)]
    n_near = (gaps[1] <= 0.45).sum(-1, keepdims=True)
    pursuers = {
        "advance": gaps[0] - gaps[1],
        "captured": 1.0 * (n_near >= 3) * np.ones_like(gaps[0]),
        "step": np.ones_like(gaps[0]),
    }
    own = {
        name: np.concatenate([values, -values.mean(-1, keepdims=True)], axis=-1)
        for name, values in pursuers.items()
    }
    is_evader = np.arange(old.shape[1]) == old.shape[1] - 1
    won = np.where(is_evader, now.truncations[:, None], now.successes[:, None])
    return {**own, "won": won}


VALUES: dict[str, Callable[[Task, Step, Step], Values]] = {
    "coop_nav": navigation,
    "coop_nav-unassigned": unassigned,
    "formation-n8": formation,
    "transport": transport,
    "transport-hard": transport,
    "posed": transport,
    "warehouse": warehouse,
    "intersection": intersection,
    "search": search,
    "pursuit-n6": pursuit,
    "pursuit-sight": pursuit,
    "tag": tag,
}


POSED = preset("transport").with_updates(
    rules=TransportRules(
        payload=Payload(shape="box"), goal_angle=0.3, rewards=TransportRewards(team_share=0.4)
    )
)


def evaluate(formula: str, weight: float, values: Values) -> Any:
    """A formula as NumPy reads it."""
    text = formula.replace("'", "_old").replace("not ", "1 - ")
    text = text.replace("[", "1.0 * (").replace("]", ")")
    functions = {"min": np.minimum, "max": np.maximum, "weight": weight, "__builtins__": {}}
    return eval(text, functions, values)


VARIANTS = ("transport-hard", "posed", "pursuit-sight")


@pytest.mark.parametrize(
    "name", [*(name for name in VALUES if name not in VARIANTS), *slow(*VARIANTS)]
)
def test_the_formulas_are_what_is_computed(name: str) -> None:
    """Row 45: what was shared was nowhere written with its numbers."""
    spec = POSED if name == "posed" else preset(name)
    n_copies = 16 if name == "intersection" else 8  # its robots touch seldom
    env = make_env(spec, n_copies)
    task: Task = env.task
    terms = reward_terms(task)
    weights = np.array([term.signed_weight for term in terms])
    rng = np.random.default_rng(1)
    steps = [env.reset(np.arange(n_copies, dtype=np.uint64))]
    for _ in range(min(spec.horizon, 150)):
        r = robots(steps[-1].states, spec.n_agents)
        towards = np.clip(2 * (r[..., 6:] - r[..., :2]), -1, 1)
        actions = towards + rng.normal(scale=0.3, size=towards.shape)
        steps.append(env.step(np.clip(actions, -1, 1)))
    before, now = joined(steps[:-1]), joined(steps[1:])
    values = {**common(task, before, now), **VALUES[name](task, before, now)}
    active = ~before.ended
    total = np.zeros(now.rewards.shape)
    tried = set()
    for column, term in zip(np.moveaxis(now.reward_terms, -1, 0), terms, strict=True):
        value = evaluate(term.value, 1.0, values) * np.ones_like(total)
        np.testing.assert_allclose(
            column[active], value[active], rtol=0, atol=CLOSE, err_msg=term.name
        )
        part = evaluate(term.formula, term.weight, values) * np.ones_like(total)
        if part[active].any():
            tried.add(term.name)
        total += part
    share = spec.rules.rewards.team_share
    np.testing.assert_array_equal(now.rewards, plain(now.reward_terms, weights, share))
    total = (1 - share) * total + share * total.mean(-1, keepdims=True)
    np.testing.assert_allclose(now.rewards[active], total[active], rtol=0, atol=CLOSE)
    assert not now.reward_terms[~active].any()
    assert tried >= {"time", "proximity", "robot_contact", "obstacle_contact"}, tried


def joined(steps: Sequence[Step]) -> Step:
    """All steps of all copies as those of more copies at once."""
    return Step(*map(np.concatenate, zip(*steps, strict=True)))
