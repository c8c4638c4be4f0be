"""The fast backend and that of Pymunk's own functions give the same bits, in every world."""

import numpy as np
import pytest

from swarmdata.envs.physics.backend import Plan
from swarmdata.envs.physics.fast_backend import FastBackend
from swarmdata.envs.physics.public_backend import PublicBackend
from swarmdata.envs.world import world
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.registry.components import TASKS, make_env, make_task
from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.state_layout import TX, TY, X, Y, robots_of
from swarmdata.types import Double, Step
from tests.support.pairs import every

NAMES = (
    *TASKS.own, "coop_nav-unassigned", "coop_nav-corridor", "coop_nav-mixed", "robotarium",
    "formation-unicycle", "transport-hard",
)  # fmt: skip


def to_targets(step: Step, n_agents: int, rng: np.random.Generator) -> Double:
    """Robots hurry to their targets, with much noise, so that they touch each other."""
    robots = robots_of(step.states, n_agents).astype(np.float64)
    wish: Double = 2.0 * (robots[..., [TX, TY]] - robots[..., [X, Y]])
    return np.clip(wish + rng.normal(size=wish.shape), -1.0, 1.0)


def play_both(name: str, n_copies: int, n_steps: int) -> None:
    """Compares both backends bit for bit; copies that have ended begin anew."""
    spec = preset(name)
    fast, public = make_env(spec, n_copies), TaskEnv(make_task(spec), n_copies, PublicBackend)
    seeds, rng = np.arange(n_copies, dtype=np.uint64), np.random.default_rng(0)
    left, right, touched = fast.reset(seeds), public.reset(seeds), False
    for _ in range(n_steps):
        for field in Step._fields:
            np.testing.assert_array_equal(getattr(left, field), getattr(right, field), field)
        touched |= bool(left.events.any())
        if left.ended.any():
            ended = np.flatnonzero(left.ended)
            seeds[ended] += np.uint64(n_copies)
            left, right = fast.reset(seeds[ended], ended), public.reset(seeds[ended], ended)
        actions = to_targets(left, spec.n_agents, rng)
        left, right = fast.step(actions), public.step(actions)
    assert touched, "nothing was touched: this shows little"


@pytest.mark.parametrize(
    ("missing", "answer"), [("load_addresses", None), ("integrates_exactly", False)]
)
def test_the_public_backend_takes_over(
    monkeypatch: pytest.MonkeyPatch, missing: str, answer: object
) -> None:
    plan = Plan(preset("coop_nav"), make_task(preset("coop_nav")).kinds, ())
    assert isinstance(world.make_backend(plan, 1), FastBackend)
    monkeypatch.setattr(world, missing, lambda: answer)
    assert isinstance(world.make_backend(plan, 1), PublicBackend)


@pytest.mark.parametrize("name", every(3, NAMES))
def test_both_backends_give_the_same_bits(name: str) -> None:
    play_both(name, 4, 80)


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in preset_names() if preset(n).backend == "pymunk"])
def test_both_backends_give_the_same_bits_in_100_episodes(name: str) -> None:
    play_both(name, 50, 2 * preset(name).horizon + 2)
