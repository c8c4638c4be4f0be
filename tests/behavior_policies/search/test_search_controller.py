"""The scripted controller of `search`: what it reads of messages, and that teams rescue."""

import numpy as np

from swarmdata.behavior_policies.heard_goals import HEARD_X, HEARD_Y, HeardGoals
from swarmdata.behavior_policies.search.search_controller import SearchController
from swarmdata.behavior_policies.search.search_team import observed_square
from swarmdata.envs.search.search import Search
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset

SPEC = preset("search")


def test_robots_that_take_no_notes_decide_the_same_whatever_was_before() -> None:
    env, copies = make_env(SPEC, 4), np.arange(4)
    settled, fresh = (SearchController(SPEC, remembers=False) for _ in range(2))
    step = env.reset(np.arange(4, dtype=np.uint64))
    settled.reset(step, copies)
    for _ in range(60):
        fresh.reset(step, copies)
        actions = settled.act(step)
        np.testing.assert_array_equal(actions, fresh.act(step))
        step = env.step(actions)


def test_robots_that_take_no_notes_search_what_they_observe_and_nobody_is_nearer_to() -> None:
    env = make_env(SPEC, 8)
    controller = SearchController(SPEC, remembers=False)
    step = env.reset(np.arange(8, dtype=np.uint64))
    controller.reset(step, np.arange(8))
    heard, names = (
        HeardGoals(Search(SPEC)).of(step),
        [each.name for each in features_of(Search(SPEC))],
    )
    middles = controller._floor.middles
    for b, i in np.ndindex(8, 4):
        offsets = step.observations[b, i, [names.index(f"unsearched_{k}.offset_{axis}")
                                           for k in range(4) for axis in "xy"]]  # fmt: skip
        nearer = step.observations[b, i, [names.index(f"unsearched_{k}.offset_way_nearer")
                                          for k in range(4)]]  # fmt: skip
        chosen = observed_square(i, step.states[b], heard[b], controller._floor)
        slot = np.flatnonzero(nearer == 0.0)[0] if (nearer == 0.0).any() else 0
        expected = heard[b, i, i, HEARD_X : HEARD_Y + 1] + offsets[2 * slot : 2 * slot + 2]
        np.testing.assert_allclose(middles[chosen], expected, atol=1e-5)
