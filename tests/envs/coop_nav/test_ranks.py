"""Ranked goals: where they are, that two rules cannot be mixed, and what is refused."""

from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.envs.coop_nav.ranks import is_cycle
from swarmdata.errors import SpecError
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_env, make_task
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import N_COLUMNS, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from tests.envs.worlds import arranged

SPEC = preset("coop_nav-ranks")


def covered(order: tuple[int, ...], follows_y: tuple[bool, ...]) -> set[int]:
    """Goals of robots of which some follow rule y and the others rule x."""
    return {order.index(i) if y else i for i, y in enumerate(follows_y)}


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_rules_cannot_be_mixed_exactly_if_the_order_is_one_cycle(n: int) -> None:
    for order in permutations(range(n)):
        mixes = [mix for mix in product([False, True], repeat=n) if 0 < sum(mix) < n]
        fails = all(len(covered(order, mix)) < n for mix in mixes)
        assert is_cycle(order) == fails or n == 1, order


@pytest.mark.slow
def test_goals_have_their_ranks_and_places_their_distances_in_every_episode() -> None:
    step = make_env(SPEC, 300).reset(np.arange(300, dtype=np.uint64))
    starts = robots_of(step.states, 4)[..., [X, Y]].astype(np.float64)
    goals = step.states[:, 4 * N_COLUMNS :].reshape(-1, 4, 2).astype(np.float64)
    radius, s = SPEC.robots[0].radius, SPEC.spawn
    assert (goals[..., 0].argsort(axis=1) == np.arange(4)).all()
    assert (goals[..., 1].argsort(axis=1).argsort(axis=1) == [2, 0, 3, 1]).all()
    for points, apart in ((starts, s.start_separation), (goals, s.goal_separation)):
        gaps = np.linalg.norm(points[:, :, None] - points[:, None], axis=-1) + 9.0 * np.eye(4)
        assert gaps.min() >= 2 * radius + apart
        assert np.abs(points).max() <= 2.0 - radius - s.goal_clearance
    away = np.linalg.norm(starts[:, :, None] - goals[:, None], axis=-1)
    assert away.min() >= s.min_goal_distance
    assert len(np.unique(starts.reshape(300, -1), axis=0)) == 300


def test_robots_do_not_see_each_other_at_the_start() -> None:
    step = make_env(SPEC, 100).reset(np.arange(100, dtype=np.uint64))
    features = [each.name for each in features_of(make_task(SPEC))]
    masks = [k for k, name in enumerate(features) if name.endswith("mask")]
    assert len(masks) == 6  # of robots and of obstacles
    assert not step.observations[..., masks].any()


@given(n=st.integers(1, 6), spacing=st.floats(0.3, 2.0), jitter=st.floats(0.0, 0.4))
def test_every_spec_is_refused_or_has_its_goals_inside(
    n: int, spacing: float, jitter: float
) -> None:
    order = [(k + 1) % n for k in range(n)]
    spec = arranged(
        SPEC, {"order": order, "spacing": spacing, "jitter": jitter}, team=[{"count": n}]
    )
    try:
        make_task(spec)
    except SpecError:
        return
    step = make_env(spec, 3).reset(np.arange(3, dtype=np.uint64))
    goals = step.states[:, n * N_COLUMNS :].reshape(-1, n, 2)
    assert np.abs(goals).max() <= 2.0 - spec.robots[0].radius
    assert (goals[..., 1].argsort(axis=1).argsort(axis=1) == order).all()


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (
            arranged(SPEC, {"order": [1, 0, 3, 2]}),
            r"order is \[1, 0, 3, 2\], expected a permutation",
        ),
        (arranged(SPEC, {"order": [1, 2, 0]}), "of 0 to 3 for 4 robots that is one cycle"),
        (arranged(SPEC, {"order": [1, 1, 0, 2]}), "that is one cycle"),
        (arranged(SPEC, {"spacing": 0.6}), r"spacing is 0\.6 m, expected at least 0\.69 m"),
        (
            arranged(SPEC, {"distance": 0.9}),
            "goals can be nearer to starts than spawn.min_goal_distance",
        ),
        (
            arranged(SPEC, arena={"width": 2.9, "height": 4.0}),
            r"needs an arena of 2\.99 m x 3\.99 m",
        ),
        (
            arranged(SPEC).with_updates(rules={**SPEC.rules.model_dump(), "goals": "assigned"}),
            "rules.goals is 'assigned' with arrangement 'ranks', expected 'unassigned'",
        ),
    ],
)
def test_what_does_not_fit_is_refused(spec: TaskSpec, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        make_task(spec)
