"""Ways around obstacles: where they lead, how long they are, and what they do not depend on."""

from collections.abc import Sequence

import numpy as np
import pytest

from swarmdata.numerics.geometry import POCKET, clearance
from swarmdata.perception.observer import Observer
from swarmdata.perception.wayfinder import paths_kept
from swarmdata.registry.components import make_env, make_policy, make_task
from swarmdata.registry.presets import preset
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.state_layout import TX, UX, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float, Step

POCKET_ROW = np.array([[POCKET, 0.0, 0.0, 0.0, 1.0, 0.4, 0.4, 0.05]], dtype=np.float32)
"""A pocket that opens towards -x."""

ONE_POCKET = {"circles": 0, "boxes": 0, "corners": 0, "pockets": 1}
OWN_WAY = ("own.goal_way_x", "own.goal_way_y", "own.goal_way_length")
DIAGONAL = 4.0 * np.sqrt(2.0)


def world(observation: str = "state+ways", communication: str = "none") -> TaskSpec:
    spec = TaskSpec.parse({"obstacles": ONE_POCKET, "team": [{"count": 1}]})
    return with_models(spec, observation, communication)


def columns(spec: TaskSpec, names: Sequence[str]) -> list[int]:
    known = [feature.name for feature in make_env(spec, 1).features]
    return [known.index(name) for name in names]


class Robots:
    """Robots that are put anywhere beside the pocket, with targets, and asked for their ways."""

    def __init__(self, spec: TaskSpec, n_copies: int = 1) -> None:
        self.spec, self.env = spec, make_env(spec, n_copies)
        self.step: Step = self.env.reset(np.arange(n_copies, dtype=np.uint64))
        self.step.layouts[:] = POCKET_ROW
        self.observer = Observer(make_task(spec), n_copies)

    def ways(
        self, places: Sequence[Sequence[float]], headings: Sequence[float] | None = None
    ) -> Float:
        """Ways of robots at x, y to targets x, y in the copies, [E, 3]."""
        robots = robots_of(self.step.states, self.spec.n_agents)
        rows = np.array(places, np.float32)
        robots[:, 0, :2], robots[:, 0, TX:] = rows[:, :2], rows[:, 2:]
        if headings is not None:
            robots[:, 0, UX], robots[:, 0, UX + 1] = np.cos(headings), np.sin(headings)
        every = np.ones(len(rows), np.bool_)
        self.observer.observe(self.step, None, every, np.arange(len(rows)))
        ways: Float = self.step.observations[:, 0, columns(self.spec, OWN_WAY)].copy()
        return ways


def test_the_way_to_a_place_in_sight_is_straight() -> None:
    (x, y, length), *_ = Robots(world()).ways([[-1.0, 1.0, 0.5, 1.0]])
    np.testing.assert_allclose([x, y, length * DIAGONAL], [1.0, 0.0, 1.5], atol=1e-5)
    (x, y, length), *_ = Robots(world()).ways([[-1.0, 1.0, -1.0, 1.15]])
    np.testing.assert_allclose([x, y, length * DIAGONAL], [0.0, 0.5, 0.15], atol=1e-5)


def test_the_way_leads_out_of_a_pocket_without_touching_it() -> None:
    robots, (x, y), travelled = Robots(world()), (0.1, 0.0), 0.0
    (first,) = robots.ways([[x, y, 1.2, 0.0]])
    assert first[0] < 0.0  # away from the target
    for _ in range(200):
        (way,) = robots.ways([[x, y, 1.2, 0.0]])
        x, y = x + 0.04 * float(way[0]), y + 0.04 * float(way[1])
        travelled += 0.04 * float(np.hypot(way[0], way[1]))
        assert clearance(x, y, POCKET_ROW, np.array([2.0, 2.0])) > 0.12
    assert (x, y) == pytest.approx((1.2, 0.0), abs=1e-3)
    assert travelled <= first[2] * DIAGONAL <= 1.6 * travelled  # closeness to surfaces counts too


@pytest.mark.slow
def test_ways_depend_on_nothing_that_was_asked_before() -> None:
    rng = np.random.default_rng(0)
    places = rng.uniform(-1.7, 1.7, size=(4 * paths_kept(1), 4))
    used = Robots(world())
    for _ in range(2):  # more places than paths are kept for, twice
        for place in places:
            found = used.ways([list(place)])
            np.testing.assert_array_equal(found, Robots(world()).ways([list(place)]))
    together = Robots(world(), len(places)).ways(places.tolist())
    alone = [used.ways([list(place)])[0] for place in places]
    np.testing.assert_array_equal(together, alone)


def test_another_layout_is_mapped_anew() -> None:
    robots, place = Robots(world()), [[-0.5, 0.0, 1.2, 0.0]]
    around = robots.ways(place)[0, 2]
    robots.step.layouts[0, 0, 1:3] = [0.0, 1.4]  # the pocket is elsewhere
    assert robots.ways(place)[0, 2] * DIAGONAL == pytest.approx(1.7, abs=1e-4)
    assert around * DIAGONAL > 2.0


@pytest.mark.parametrize("kind", ["lidar", "bearing", "occupancy"])
def test_body_frames_turn_the_way(kind: str) -> None:
    place, angle = [[-0.5, 0.0, 1.2, 0.3]], 2.1
    (x, y, length), *_ = Robots(world()).ways(place)
    (turned_x, turned_y, same), *_ = Robots(world(f"{kind}+ways")).ways(place, [angle])
    c, s = np.cos(angle), np.sin(angle)
    np.testing.assert_allclose([turned_x, turned_y], [c * x + s * y, c * y - s * x], atol=1e-6)
    assert same == length


def test_the_way_to_a_hidden_goal_is_hidden() -> None:
    spec = world("state+ways+goal-for-3")
    env = make_env(spec, 1)
    step = env.reset(np.array([1], np.uint64))
    at, shown = columns(spec, OWN_WAY), []
    for _ in range(5):
        shown.append(bool(step.observations[0, 0, at].any()))
        step = env.step(np.zeros((1, 1, 2), np.float32))
    assert shown == [True] * 3 + [False] * 2


def test_a_late_sensor_knows_the_way_from_where_the_robot_was() -> None:
    plain, late = world("state+ways"), world("state+ways+delay-2")
    found = []
    for spec in (plain, late):
        (episode,) = rollout(
            make_env(spec, 1), make_policy("scripted", spec), np.array([3], np.uint64)
        )
        found.append(episode.observations[:30][..., columns(spec, OWN_WAY)])
    np.testing.assert_array_equal(found[1][2:], found[0][:-2])


def test_messages_tell_places_to_which_there_is_a_way() -> None:
    spec = preset("search")
    names = [feature.name for feature in make_env(spec, 1).features]
    assert [name for name in names if "_way" in name] == [
        f"{place}_way{end}"
        for place in (
            "own.goal",
            *(f"unsearched_{k}.offset" for k in range(4)),
            *(f"message_{k}.target" for k in range(3)),
        )
        for end in ("_x", "_y", "_length", "_nearer")
    ]
    late = with_models(spec, "state+ways", "goal+delayed-2")
    step = make_env(late, 1).reset(np.array([0], np.uint64))
    at = columns(late, [f"message_0.target_way{end}" for end in ("_x", "_y", "_length")])
    assert not step.observations[0, :, at].any()  # nothing was received
    step = make_env(spec, 1).reset(np.array([0], np.uint64))
    at = columns(spec, [f"message_0.target_way{end}" for end in ("_x", "_y", "_length")])
    assert step.observations[0, :, at].any()


def test_there_is_a_way_to_each_goal_that_anybody_may_take() -> None:
    spec = with_models(preset("coop_nav-unassigned"), "state+ways", "none")
    step = make_env(spec, 1).reset(np.array([0], np.uint64))
    lengths = columns(spec, [f"goal_{k}.offset_way_length" for k in range(spec.n_agents)])
    assert (step.observations[0][:, lengths] > 0.0).all()


@pytest.mark.parametrize("kind", ["state+ways", "lidar+ways"])
def test_who_is_nearer_to_a_place_is_counted(kind: str) -> None:
    spec = with_models(preset("coop_nav"), kind, "goal+lossy-30")
    env, policy = make_env(spec, 2), make_policy("scripted", spec)
    step, seen = env.reset(np.array([3, 4], np.uint64)), set()
    policy.reset(step, np.arange(2))
    (at,) = columns(spec, ["own.goal_way_nearer"])
    masks = columns(spec, [f"message_{k}.mask" for k in range(3)])
    for _ in range(60):
        robots = robots_of(step.states, 4).astype(np.float64)
        for e, i in np.ndindex(2, 4):
            others = [j for j in range(4) if j != i]
            heard = step.observations[e, i, masks] > 0
            fresh = step.ages[e, i, others] == 0
            if not (fresh | ~heard).all():
                continue  # senders have moved since
            target = robots[e, i, TX:]
            gaps = np.linalg.norm(robots[e, :, :2] - target, axis=-1)
            count = (gaps[others] < gaps[i])[heard].sum()
            assert step.observations[e, i, at] == pytest.approx(count / 3)
            seen.add(int(count))
        step = env.step(policy.act(step))
    assert seen == {0, 1, 2, 3}


def test_there_is_no_way_to_where_no_robot_fits() -> None:
    robots = Robots(world())
    assert not robots.ways([[-1.0, 1.0, -2.0, -2.0]]).any()  # a corner of the arena
    assert not robots.ways([[-1.0, 1.0, 0.35, 0.0]]).any()  # the pocket's wall
    assert robots.ways([[-1.0, 1.0, -1.8, -1.8]]).any()
