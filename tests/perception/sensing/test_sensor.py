"""What every model promises, however it is modified."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.interfaces import Task
from swarmdata.perception.sensing.sensor import Sensor
from swarmdata.registry.components import TASKS, make_env, make_task
from swarmdata.registry.presets import preset
from swarmdata.specs.features import Feature
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, robots_of
from swarmdata.types import Float, Step
from tests.perception.sensing import scenes

KINDS = ("state", "lidar", "bearing", "occupancy")
WORSE = {
    "noise": {"position": 0.05, "velocity": 0.04, "direction": 0.03, "range": 0.02},
    "dropout": 0.2,
    "delay": 1,
    "stack": 3,
    "drift": {"position": 0.05, "heading": 0.04, "turning": 0.03},
    "landmarks": 0.5,
}
BODY_STATE = {"kind": "state", "frame": "body"}
TEAM = [
    {"name": "scout", "count": 1, "robot": {"dynamics": "unicycle", "sensor_range": 1.0}},
    {"name": "carrier", "count": 3, "robot": {"radius": 0.18}},
]


def episode(task: Task, n_copies: int, seed: int) -> list[Step]:
    steps = [scenes.step(task, n_copies, seed, time) for time in range(5)]
    return [step._replace(layouts=steps[0].layouts) for step in steps]


def rotated(step: Step, n_agents: int, c: float, s: float) -> Step:
    """The same world, turned counter-clockwise about the origin."""
    states, layouts = step.states.copy(), step.layouts.copy()
    first = N_COLUMNS * n_agents
    columns = [
        *range(0, first, 2),
        *(k + d for k in range(first, states.shape[1], 7) for d in (0, 2, 4)),
    ]
    for array, xs in ((states, columns), (layouts, [1, 3])):
        for x in xs:
            vector = (array[..., x] + 1j * array[..., x + 1]).astype(np.complex128) * complex(c, s)
            array[..., x], array[..., x + 1] = vector.real, vector.imag
    return step._replace(states=states, layouts=layouts)


@pytest.mark.parametrize("model", [*({"kind": kind} for kind in KINDS[1:]), BODY_STATE])
@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_the_bodys_frame_turns_with_the_world(model: dict[str, str], quarters: int) -> None:
    """By quarter turns in a square arena, and by any angle where no wall is in range."""
    task = scenes.task(model, has_bodies=True, has_features=True)
    step = scenes.step(task, 3, 5)
    wide = {"width": 40.0, "height": 40.0}
    open_task = scenes.task(model, has_bodies=True, has_features=True, arena=wide)
    angle = quarters + 0.5
    for where, c, s in [
        (task, *[(1, 0), (0, 1), (-1, 0), (0, -1)][quarters]),
        (open_task, np.cos(angle), np.sin(angle)),
    ]:
        before, after = scenes.run(where, [step, rotated(step, 4, c, s)])[0]
        # a grazing ray or a cell's edge may fall either way
        assert np.mean(abs(before - after) > 1e-4) < 0.005


@pytest.mark.parametrize("kind", KINDS)
@given(seed=st.integers(0, 2**32))
def test_a_copy_observes_the_same_alone_and_in_any_batch(kind: str, seed: int) -> None:
    task = scenes.task({"kind": kind, **WORSE}, has_bodies=True, has_features=True, team=TEAM)
    steps = episode(task, 3, seed)
    together = scenes.run(task, steps)[0]
    for b in range(3):
        part = [
            step._replace(
                states=step.states[[b]],
                layouts=step.layouts[[b]],
                seeds=step.seeds[[b]],
                times=step.times[[b]],
            )
            for step in steps
        ]
        np.testing.assert_array_equal(scenes.run(task, part)[0][:, 0], together[:, b])


@pytest.mark.parametrize("kind", KINDS)
def test_to_forget_is_to_be_fresh(kind: str) -> None:
    task = scenes.task({"kind": kind, **WORSE}, team=TEAM)
    first, second = (episode(task, 2, seed) for seed in (1, 2))
    used = Sensor(task, 2)
    scenes.run(task, first, used)
    used.forget(np.array([0, 1]))
    again, fresh = scenes.run(task, second, used)[0], scenes.run(task, second)[0]
    np.testing.assert_array_equal(again, fresh)


@pytest.mark.parametrize("modifiers", [{}, WORSE])
@pytest.mark.parametrize("kind", KINDS)
def test_rows_of_other_copies_and_columns_of_others_are_not_written(
    kind: str, modifiers: dict[str, Any]
) -> None:
    task = scenes.task({"kind": kind, **modifiers}, has_features=True, team=TEAM)
    sensor, step = Sensor(task, 3), scenes.step(task, 3, 1)
    wide = np.full((3, 4, len(sensor.features) + 7), -5, dtype=np.float32)
    sensor.observe(step, np.array([True, False, True]), wide[..., :-7])
    assert (wide[1] == -5).all()
    assert (wide[..., -7:] == -5).all()
    tight = scenes.run(task, [step])[0][0]
    np.testing.assert_array_equal(wide[[0, 2], :, :-7], tight[[0, 2]])
    assert np.isfinite(tight).all()


@pytest.mark.parametrize("kind", KINDS)
def test_names_are_unique_and_the_role_comes_last(kind: str) -> None:
    task = scenes.task({"kind": kind, "stack": 2}, has_features=True, team=TEAM)
    sensor = Sensor(task, 1)
    names = [feature.name for feature in sensor.features]
    assert len(set(names)) == len(names)
    assert names[-2:] == ["role.scout", "role.carrier"]
    size = (len(names) - 2) // 2
    assert [f"{name}[-1]" for name in names[:size]] == names[size:-2]
    out = scenes.observe(task, scenes.step(task, 1, 0))[0]
    np.testing.assert_array_equal(out[:, -2:], [[1, 0], [0, 1], [0, 1], [0, 1]])


@pytest.mark.parametrize("kind", KINDS)
def test_what_the_task_adds_is_in_the_models_frame(kind: str) -> None:
    """The task gives each robot's heading, which is (1, 0) in its own frame."""
    task = scenes.task({"kind": kind}, has_features=True)
    step, sensor = scenes.step(task, 2, 3), Sensor(task, 1)
    out = scenes.observe(task, step)[..., -3:]
    assert [f.name for f in sensor.features[-3:]] == ["slot_x", "slot_y", "number"]
    headings = robots_of(step.states, 4)[..., 4:6]
    expected = headings if kind == "state" else np.broadcast_to([1, 0], headings.shape)
    np.testing.assert_allclose(out[..., :2], expected, atol=1e-6)
    np.testing.assert_array_equal(out[..., 2], [range(4)] * 2)


def seen(kind: str, **model: Any) -> tuple[tuple[Feature, ...], Float]:
    """The features of a model, and what robots observe with it in an episode."""
    task = scenes.task({"kind": kind, **model}, has_features=True, team=TEAM)
    return Sensor(task, 2).features, scenes.run(task, episode(task, 2, 7))[0]


@pytest.mark.parametrize("worse", [{}, WORSE])
@pytest.mark.parametrize("kind", KINDS)
def test_the_goal_is_hidden_after_its_steps_and_nothing_else_changes(
    kind: str, worse: dict[str, Any]
) -> None:
    """A frame sensed while the goal was shown still shows it when it is late or stacked."""
    features, expected = seen(kind, **worse)
    hiding, got = seen(kind, **worse, goal_steps=2)
    delay = worse.get("delay", 0)
    for column, feature in enumerate(features):
        assert ("shown_" in hiding[column].name) == feature.tells_goal
        age = int(feature.name.partition("[-")[2].rstrip("]") or 0)
        for t in range(len(expected)):
            is_hidden = feature.tells_goal and t - delay - age >= 2
            want = 0 if is_hidden else expected[t, ..., column]
            np.testing.assert_array_equal(got[t, ..., column], want)
    assert sum(feature.tells_goal for feature in features) > 0


@pytest.mark.parametrize("worse", [{}, WORSE])
@pytest.mark.parametrize("kind", KINDS)
def test_without_velocities_the_other_features_stay_as_they_are(
    kind: str, worse: dict[str, Any]
) -> None:
    features, expected = seen(kind, **worse)
    without, got = seen(kind, **worse, velocities=False)
    kept = [k for k, feature in enumerate(features) if feature.kind != "velocity"]
    assert len(kept) < len(features)
    assert without == tuple(features[k] for k in kept)
    np.testing.assert_array_equal(got, expected[..., kept])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["coop_nav-unassigned", "transport-hard", *TASKS])
def test_a_hidden_goal_is_in_no_feature_of_any_task(name: str, kind: str) -> None:
    spec = with_models(preset(name), f"{kind}+goal-for-0", "none")
    step = make_env(spec, 2).reset(np.arange(2, dtype=np.uint64))
    task, states = make_task(spec), step.states.copy()
    robots_of(states, spec.n_agents)[..., TX : TY + 1] *= -0.5
    before, after = (scenes.run(task, [each])[0] for each in (step, step._replace(states=states)))
    np.testing.assert_array_equal(before, after)
    shown = make_task(preset(name))
    seen, other = scenes.run(shown, [step, step._replace(states=states)])[0]
    assert not np.array_equal(seen, other)


def test_the_bodys_frame_has_no_coordinates_of_the_world() -> None:
    """Neither the own position nor the heading: a world that is moved and turned looks the same."""
    task, world = (
        scenes.task(model, has_bodies=True, has_features=True)
        for model in (BODY_STATE, {"kind": "state"})
    )
    names = [feature.name for feature in Sensor(task, 1).features]
    assert names == [f.name for f in Sensor(world, 1).features if f.name not in ("own.x", "own.y")]
    step = scenes.step(task, 3, 5)
    states, layouts = step.states.copy(), step.layouts.copy()
    for column in (*range(0, 32, 8), *range(6, 32, 8), *range(32, states.shape[1], 7)):
        states[:, column] += 3
    layouts[..., 1] += 3
    moved = rotated(step._replace(states=states, layouts=layouts), 4, np.cos(1.0), np.sin(1.0))
    before, after = scenes.run(task, [step, moved])[0]
    np.testing.assert_allclose(before, after, atol=1e-5)
    first = names.index("own.heading_x")
    np.testing.assert_array_equal(before[..., first : first + 2], [[[1, 0]] * 4] * 3)
