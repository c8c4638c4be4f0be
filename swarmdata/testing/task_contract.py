"""check_task, the contract of every task."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import SchemaError
from swarmdata.interfaces import Task, VecEnv
from swarmdata.numerics.geometry import clearance
from swarmdata.numerics.random import derive, uniform
from swarmdata.numerics.weighted_terms import weighted_rewards
from swarmdata.registry.components import reward_terms
from swarmdata.specs.state_layout import TX, UX, UY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.column_meanings import state_columns
from swarmdata.types import EVENTS, Bool, Seeds, Step

MakeEnv = Callable[[TaskSpec, int], VecEnv]

SPEED_TOLERANCE = 1e-3
"""Largest rounding error of a speed, m/s."""

SKID_SHARE = 0.02
"""By how much robots on wheels may be faster than their wheels, which skid sideways in turns."""

MAX_PENETRATION = 0.03
"""Largest overlap with walls and obstacles, which a push at top speed causes for one step, m."""


def check_task(make_env: MakeEnv, spec: TaskSpec, n_steps: int = 60) -> None:
    """Checks a task's environment against `interfaces.VecEnv`.

    Shapes and dtypes are those of `Step`; values are finite; terminations and truncations exclude
    each other; the horizon truncates; an ended copy stays put; an episode is the same, bit for bit,
    alone, in a batch and after other episodes; earlier steps are never written to again; the task
    leaves what is final in a step; actions that are not finite are refused; the rewards are their
    terms times the weights, bit for bit, and the terms of contacts are the events; no robot is
    outside the arena, inside an obstacle, or, unless it is pushed, faster than the fastest may be
    (with backend `kinematic`, which has no contacts, only the speed is checked); empty slots of
    observations are zero; every state column, feature and term of the reward is described.

    Args:
        make_env: builds E copies of the task.
        spec: the task to build.
        n_steps: control steps to play.

    Raises:
        AssertionError: naming the broken promise.
    """
    seeds = np.arange(5, 9, dtype=np.uint64)
    batch = make_env(spec, 4)
    _watch_updates(batch.task)
    steps = _play(batch, seeds, n_steps)
    for step in steps:
        _check_arrays(step, batch, 4)
    _check_ends(steps, spec)
    _check_motion(steps, spec, bool(batch.task.movables))
    _check_slots(steps, batch)
    _check_rewards(steps, batch)
    _check_words(batch)
    used = make_env(spec, 1)
    _play(used, np.array([99], dtype=np.uint64), n_steps // 2)
    alone = _play(used, seeds[2:3], n_steps)
    for left, right in zip(steps, alone, strict=True):
        for name in Step._fields:
            same = np.array_equal(getattr(left, name)[2], getattr(right, name)[0])
            assert same, f"{name} depends on the batch or on earlier episodes"
    _check_refusals(batch)


def _watch_updates(task: Task) -> None:
    """Lets a task's `update` fail if it writes to what is final in a step."""
    n, update = task.spec.n_agents, task.update

    def watched(before: Step, now: Step, active: Bool, solved: Bool) -> None:
        def final() -> dict[str, NDArray[Any]]:
            moved = {"robots in states": robots_of(now.states, n)[..., :TX]}
            moved |= {name: getattr(now, name) for name in ("times", "events", "layouts", "seeds")}
            return {name: array.copy() for name, array in moved.items()}

        kept = final()
        update(before, now, active, solved)
        for name, array in final().items():
            same = np.array_equal(array, kept[name])
            assert same, f"update() wrote to the {name}, which are final in a step"

    task.update = watched  # type: ignore[method-assign]


def _play(env: VecEnv, seeds: Seeds, n_steps: int) -> list[Step]:
    """Plays random actions that depend on seed and time only; checks that steps are not reused."""
    steps = [env.reset(seeds)]
    agents, columns = np.arange(env.spec.n_agents)[:, None], np.arange(env.action_size)
    for _ in range(n_steps):
        step = steps[-1]
        kept = [array.copy() for array in step]
        times = step.times[:, None, None] // 10
        steps.append(
            env.step(2 * uniform(derive(step.seeds[:, None, None], times, agents, columns)) - 1)
        )
        for name, array, copy in zip(Step._fields, steps[-2], kept, strict=True):
            same = np.array_equal(np.asarray(array), copy)
            assert same, f"step() wrote to the earlier step's {name}"
    return steps


def _check_arrays(step: Step, env: VecEnv, e: int) -> None:
    n, m = env.spec.n_agents, step.layouts.shape[1]
    expected = {
        "observations": ((e, n, env.observation_size), np.float32),
        "states": ((e, env.state_size), np.float32),
        "rewards": ((e, n), np.float32),
        "reward_terms": ((e, n, len(reward_terms(env.task))), np.float32),
        "terminations": ((e,), np.bool_),
        "truncations": ((e,), np.bool_),
        "successes": ((e,), np.bool_),
        "events": ((e, n, 4), np.uint8),
        "seeds": ((e,), np.uint64),
        "times": ((e,), np.int64),
        "layouts": ((e, m, 8), np.float32),
        "sent": ((e, n, step.sent.shape[2]), np.float32),
        "delivered": ((e, n, n if step.sent.shape[2] else 0), np.bool_),
        "ages": ((e, n, n if step.sent.shape[2] else 0), np.uint8),
    }
    for name, (shape, dtype) in expected.items():
        array = getattr(step, name)
        assert array.shape == shape, f"{name} has shape {array.shape}, expected {shape}"
        assert array.dtype == dtype, f"{name} has dtype {array.dtype}, expected {np.dtype(dtype)}"
        assert np.isfinite(array).all(), f"{name} holds a value that is not finite"


def _check_ends(steps: list[Step], spec: TaskSpec) -> None:
    ended: Bool = np.zeros(len(steps[0].seeds), dtype=np.bool_)
    for before, step in pairwise(steps):
        assert not (step.terminations & step.truncations).any(), "an end of two kinds"
        assert (step.successes <= step.terminations).all(), "a success without termination"
        assert (step.truncations <= (step.times == spec.horizon)).all(), (
            "truncation before the horizon"
        )
        assert (step.ended | (step.times < spec.horizon)).all(), "an episode outlived the horizon"
        assert not step.rewards[ended].any(), "a copy that ended got a reward"
        assert not step.reward_terms[ended].any(), "a copy that ended has a term of a reward"
        assert (step.states[ended] == before.states[ended]).all(), "a copy that ended moved"
        assert (ended <= step.ended).all(), "a copy that ended went on without a reset"
        ended = step.ended


def _check_motion(steps: list[Step], spec: TaskSpec, has_movables: bool) -> None:
    """Speed limits hold, headings are unit vectors, and robots do not pass through obstacles.

    In contact, a robot may be pushed beyond its speed limit by another's acceleration in one step;
    once it is free, its motors take a step to brake. Contacts with movable bodies are not recorded,
    so with these any robot may be in contact.
    """
    radii = np.array([robot.radius for robot in spec.robots])
    top = max(spec.largest("max_speed"))
    push = max(spec.largest("max_acceleration")) / _lightest(spec) * spec.control_dt
    half = np.array([spec.arena.width / 2, spec.arena.height / 2])
    if any(robot.base == "wheels" for robot in spec.robots):
        top *= 1.0 + SKID_SHARE
    touched_before: Bool = np.zeros(steps[0].events.shape[:2], np.bool_)
    for step in steps:
        robots = robots_of(step.states, spec.n_agents).astype(np.float64)
        speeds = np.hypot(robots[..., VX], robots[..., VY])
        touched = np.logical_or(step.events[..., :2].any(-1), has_movables)
        allowed = top + SPEED_TOLERANCE + push * (touched | touched_before)
        excess = (speeds - allowed).max()
        assert excess <= 0, f"a robot drives {excess:.4f} m/s faster than its limits allow"
        touched_before = touched | (touched_before & step.ended[:, None])  # stands still
        headings = np.hypot(robots[..., UX], robots[..., UY])
        assert np.allclose(headings, 1.0, atol=1e-5), "a heading is no unit vector"
        if spec.backend == "kinematic":
            continue
        for layout, team in zip(step.layouts, robots, strict=True):
            for radius, robot in zip(radii, team, strict=True):
                gap = clearance(robot[X], robot[Y], layout, half) - radius
                assert gap >= -MAX_PENETRATION, f"a robot is {-gap:.3f} m deep in something solid"


def _lightest(spec: TaskSpec) -> float:
    """The smallest mass of a robot in any episode, kg."""
    drawn = spec.randomization.mass
    return min(robot.mass for robot in spec.robots) if drawn is None else drawn[0]


def _check_slots(steps: list[Step], env: VecEnv) -> None:
    """Slots whose mask is 0 are 0."""
    slots: dict[str, list[int]] = {}
    for column, feature in enumerate(env.features):
        slots.setdefault(feature.slot, []).append(column)
    masks = {f.slot: c for c, f in enumerate(env.features) if f.is_mask}
    for step in steps:
        for slot, mask in masks.items():
            values = step.observations[..., slots[slot]]
            assert np.isin(step.observations[..., mask], (0, 1)).all(), (
                f"{slot}: mask is not 0 or 1"
            )
            assert not values[step.observations[..., mask] == 0].any(), f"{slot} is empty, not zero"


def _check_rewards(steps: list[Step], env: VecEnv) -> None:
    """Rewards follow from their terms, and the terms of contacts are the events."""
    terms, share = reward_terms(env.task), env.spec.rules.rewards.team_share
    weights = np.array([term.signed_weight for term in terms])
    names = [term.name for term in terms]
    first = names.index("robot_contact")
    ended: Bool = np.zeros(len(steps[0].seeds), dtype=np.bool_)
    for step in steps:
        expected = weighted_rewards(step.reward_terms, weights, share, env.spec.side_bounds)
        assert np.array_equal(step.rewards, expected), "rewards are not their terms times weights"
        contacts = step.reward_terms[..., first : first + len(EVENTS)]
        assert np.array_equal(contacts, step.events), "terms of contacts are not the events"
        won = step.reward_terms[..., names.index("success")] > 0
        (_, *others), first_end = env.spec.sides, env.spec.side_bounds[1]
        assert (won[:, :first_end] >= step.successes[:, None]).all(), "a success without its term"
        if others:
            held = (step.truncations & ~ended)[:, None]
            assert (won[:, first_end:] == held).all(), "sides succeed only if the first does not"
        ended = step.ended


def _check_words(env: VecEnv) -> None:
    """State columns and features have names and meanings; every reward weight has one term."""
    task = env.task
    columns = state_columns(task)
    assert len(columns) == env.state_size, f"{env.state_size} state columns, {len(columns)} named"
    for described in (columns, env.features):
        meanings = {each.name: each.meaning for each in described}
        missing = [name for name, meaning in meanings.items() if not name or not meaning]
        assert not missing, f"{missing} have no meaning"
        assert len(meanings) == len(described), "two columns have one name"
    weights = {name for name, _ in task.spec.rules.rewards} - {"team_share"}
    terms = [term.name for term in reward_terms(task)]
    assert sorted(terms) == sorted(weights), f"terms {sorted(terms)}, weights {sorted(weights)}"
    assert task.solved, "`solved` does not say when the task is solved"


def _check_refusals(env: VecEnv) -> None:
    env.reset(np.arange(4, dtype=np.uint64))
    bad = np.zeros((4, env.spec.n_agents, env.action_size))
    bad[1, 0, 0] = np.nan
    for actions in (bad, bad[:, :1, :1]):
        try:
            env.step(actions)
        except SchemaError:
            continue
        raise AssertionError("malformed actions were accepted")
