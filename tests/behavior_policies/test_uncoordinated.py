"""Teams with less coordination: what a robot cannot see, it does not react to."""

import numpy as np
import pytest

from swarmdata import evaluate, make_env
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_policy
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import TX, TY, robots_of
from swarmdata.testing.comparing import act_on


def test_a_robot_alone_ignores_where_others_are() -> None:
    spec = preset("coop_nav")
    step = make_env(spec, 1).reset(evaluation_seeds(1))
    moved = step._replace(states=step.states.copy())
    moved.states[0, 8:10] = moved.states[0, :2] + np.float32(0.3)  # the second beside the first
    actions = {}
    for name in ("scripted", "scripted-alone"):
        for where, shown in (("there", step), ("near", moved)):
            actions[name, where] = act_on(make_policy(name, spec), shown)[0, 0]

    assert not np.array_equal(actions["scripted", "there"], actions["scripted", "near"])
    assert np.array_equal(actions["scripted-alone", "there"], actions["scripted-alone", "near"])


@pytest.mark.parametrize("name", ["scripted-alone", "scripted-naive"])
def test_each_robot_knows_where_the_payload_goes(name: str) -> None:
    spec = preset("transport")
    step = make_env(spec, 1).reset(evaluation_seeds(1))
    elsewhere = step._replace(states=step.states.copy())
    robots_of(elsewhere.states, spec.n_agents)[..., [TX, TY]] *= np.float32(-1.0)
    here, there = (act_on(make_policy(name, spec), shown) for shown in (step, elsewhere))

    assert (here != there).any(axis=-1).all()


@pytest.mark.slow
def test_goals_are_assigned_among_all_robots() -> None:
    spec = preset("coop_nav-unassigned")
    alone = evaluate(make_policy("scripted-alone", spec), spec, n_episodes=4, progress=False)

    assert alone.metrics["success"].mean() >= 0.75  # and all fail if each plans for itself


@pytest.mark.slow
def test_the_gap_of_a_corridor_is_large() -> None:
    spec = preset("coop_nav-corridor")
    success = {
        name: evaluate(make_policy(name, spec), spec, n_episodes=12, progress=False)
        .metrics["success"]
        .mean()
        for name in ("scripted", "scripted-alone", "scripted-naive")
    }

    assert success["scripted"] == 1.0
    assert success["scripted-alone"] <= 0.6
    assert success["scripted-naive"] <= 0.3


def test_a_deaf_team_does_not_react_to_messages() -> None:
    spec = preset("search")
    env = make_env(spec, 2)
    step = env.reset(evaluation_seeds(2))
    idle = np.zeros((2, spec.n_agents, spec.action_size), np.float32)
    deaf = make_policy("scripted-deaf", spec)
    deaf.reset(step, np.arange(2))
    step = env.step(idle)

    unheard = step._replace(observations=np.zeros_like(step.observations))
    assert np.array_equal(deaf.act(step), deaf.act(unheard))
