"""The scripted team of `pursuit` captures, and tells what it sees."""

import numpy as np
import pytest

from swarmdata.envs.pursuit.pursuit_rules import PursuitRules
from swarmdata.errors import SpecError
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.testing.policy_contract import check_policy
from swarmdata.types import Float


def success(policy: str, task: str, n_episodes: int = 24, channel: str | None = None) -> float:
    spec = preset(task)
    if channel is not None:
        spec = spec.with_updates(communication=channel)
    team = make_policy(policy, spec)
    found = evaluate(team, spec, name=policy, n_episodes=n_episodes, progress=False)
    return float(found.metrics["success"].mean())


@pytest.mark.slow
def test_the_ring_captures_and_the_best_naive_team_mostly_does_not() -> None:
    assert success("scripted", "pursuit") >= 0.75
    assert success("pursuit-lead-3", "pursuit") <= 0.6


@pytest.mark.slow
def test_messages_are_worth_much_where_sight_is_short() -> None:
    told, silent = (success("scripted", "pursuit-sight", 24, c) for c in ("goal", "none"))
    assert told >= silent + 0.25


SPEC = preset("pursuit")


def actions_of(name: str) -> Float:
    """After a second, in which the evader has begun to wander."""
    env, policy = make_env(SPEC, 8), make_policy(name, SPEC)
    step = env.reset(np.arange(8, dtype=np.uint64))
    for _ in range(10):
        step = env.step(np.zeros((8, 3, 2)))
    policy.reset(step, np.arange(8))
    return policy.act(step)


def test_every_naive_team_aims_elsewhere() -> None:
    found = {name: actions_of(name) for name in PursuitRules.naive_teams}
    assert len({actions.tobytes() for actions in found.values()}) == 4
    mixed = found["pursuit-lead-mixed"]  # reciprocal avoidance depends on the others' aims a little
    for i, name in enumerate(("pursuit-greedy", "pursuit-lead-1", "pursuit-lead-3")):
        np.testing.assert_allclose(mixed[:, i], found[name][:, i], atol=0.5)


def test_they_are_of_one_task() -> None:
    with pytest.raises(SpecError, match="expected 'pursuit'"):
        make_policy("pursuit-greedy", preset("search"))


@pytest.mark.parametrize("task", ["pursuit-n6", "pursuit-sight"])
def test_a_reset_forgets_what_was_before(task: str) -> None:
    spec = preset(task).with_updates(horizon=30)
    check_policy(make_policy("scripted", spec), spec, make_env, n_episodes=4)
