"""The fast backend: a used space is as good as a new one, and the public one takes over."""

import numpy as np
import pytest

from swarmdata.envs.physics.backend import Plan
from swarmdata.envs.physics.fast_backend import FastBackend
from swarmdata.envs.physics.public_backend import PublicBackend
from swarmdata.envs.world import world
from swarmdata.interfaces import VecEnv
from swarmdata.registry.components import make_env, make_task
from swarmdata.registry.presets import preset
from swarmdata.types import Step


def play(env: VecEnv, seed: int, n_steps: int) -> list[Step]:
    rng = np.random.default_rng(seed)
    steps = [env.reset(np.array([seed], dtype=np.uint64))]
    held = rng.uniform(-1.0, 1.0, (1, env.spec.n_agents, env.action_size))
    for t in range(n_steps):
        if t % 8 == 0:  # held for a while, so that robots reach things and press them
            held = rng.uniform(-1.0, 1.0, held.shape)
        steps.append(env.step(held))
    return steps


@pytest.mark.parametrize("name", ["coop_nav", "formation", "transport", "transport-hard"])
def test_an_episode_leaves_no_trace_in_the_next(name: str) -> None:
    spec = preset(name)
    used = make_env(spec)
    n_contacts = sum(int(step.events.sum()) for step in play(used, 0, 80))
    for seed in (1, 2, 3):
        again, new = play(used, seed, 60), play(make_env(spec), seed, 60)
        n_contacts += sum(int(step.events.sum()) for step in new)
        for ours, theirs in zip(again, new, strict=True):
            assert all(map(np.array_equal, ours, theirs))
    assert n_contacts > 10


@pytest.mark.parametrize(
    ("missing", "answer"), [("load_addresses", None), ("integrates_exactly", False)]
)
def test_the_public_backend_takes_over(
    monkeypatch: pytest.MonkeyPatch, missing: str, answer: object
) -> None:
    spec = preset("coop_nav")
    plan = Plan(spec, make_task(spec).kinds, ())
    assert isinstance(world.make_backend(plan, 1), FastBackend)
    monkeypatch.setattr(world, missing, lambda: answer)
    assert isinstance(world.make_backend(plan, 1), PublicBackend)
