"""Copies in which one side acts: they are those of all sides, with opponents on the others."""

import numpy as np
import pytest

from swarmdata.errors import SchemaError
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.side_env import SideEnv, seen_in, whole_of
from swarmdata.rollouts.side_policy import SidePolicy, rows_of_side, step_of_side
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.task_spec import TaskSpec

SPEC = preset("tag").with_updates(horizon=40)
SEEDS = np.arange(4, dtype=np.uint64)


def of_side(side: str, opponents: str = "scripted") -> SideEnv:
    spec = SideSpec(whole=SPEC, side=side, opponents=opponents)
    return SideEnv(make_env(SPEC, 4), spec, opponents)


@pytest.mark.parametrize("side", ["pursuers", "evader"])
def test_a_side_plays_the_episodes_of_both(side: str) -> None:
    """Also where some copies begin anew, whose opponents then have no memory of what was before."""
    env, both = of_side(side), make_env(SPEC, 4)
    own = SPEC.side(side)
    other = next(each.name for each in SPEC.sides if each.name != side)
    drawn, scripted = make_policy("random", SPEC), make_policy("scripted", SPEC)
    team = SidePolicy(SPEC, {side: drawn, other: scripted})
    seen, step = env.reset(SEEDS), both.reset(SEEDS)
    team.reset(step, np.arange(4))
    for k in range(30):
        assert env.whole_step.states.tobytes() == step.states.tobytes()
        for name, ours, theirs in zip(step._fields, seen, step_of_side(step, own), strict=True):
            np.testing.assert_array_equal(ours, theirs, err_msg=name)
        if k == 12:
            copies, fresh = np.array([1, 3]), SEEDS[:2] + 9
            seen, step = env.reset(fresh, copies), both.reset(fresh, copies)
            team.reset(step, copies)
        actions = rows_of_side("actions", drawn.act(step), own)
        seen, step = env.step(actions), both.step(team.act(step))


def test_sizes_are_those_of_the_side() -> None:
    env = of_side("evader")
    step = env.reset(SEEDS)
    assert (env.spec.n_agents, env.n_copies) == (1, 4)
    assert env.spec.robots == SPEC.robots[3:]
    assert step.observations.shape == (4, 1, env.observation_size)
    assert step.states.shape == (4, env.state_size)
    with pytest.raises(SchemaError, match=r"of the evader returned .* expected \(4, 1, 2\)"):
        env.step(np.zeros((4, 4, 2)))
    with pytest.raises(SchemaError, match="finite"):
        env.step(np.full((4, 1, 2), np.nan))
    env.close()


def test_there_is_no_step_before_a_reset() -> None:
    with pytest.raises(SchemaError, match="before the first reset"):
        of_side("evader").step(np.zeros((4, 1, 2)))


def test_a_side_is_seen_in_changed_copies_too() -> None:
    env, other = of_side("pursuers"), make_env(SPEC, 4)
    assert whole_of(env) is env.whole
    changed = seen_in(other, env)
    assert whole_of(changed) is other
    first, second = env.reset(SEEDS), changed.reset(SEEDS)
    for _ in range(5):
        first, second = (each.step(np.ones((4, 3, 2))) for each in (env, changed))
        np.testing.assert_array_equal(first.observations, second.observations)
    plain = make_env(TaskSpec(), 1)
    assert whole_of(plain) is plain
    assert seen_in(other, plain) is other
