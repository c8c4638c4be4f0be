"""Noise and losses of echoes against their NumPy twin; delay and stacking."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.interfaces import Task
from swarmdata.numerics.random import STREAMS, derive, normal, uniform
from swarmdata.perception.sensing import Sensor
from swarmdata.perception.sensing.modifiers import History, echoes_of
from swarmdata.specs.features import Feature, numbered, vector
from swarmdata.types import Float, Step

KINDS = ("state", "lidar", "bearing", "occupancy")
LOUD = {"position": 0.05, "velocity": 0.04, "direction": 0.03, "range": 0.02}


def observe(task: Task, steps: list[Step]) -> Float:
    """What a fresh sensor observes in one step after another, [T, E, N, O]."""
    n_copies = len(steps[0].states)
    sensor = Sensor(task, n_copies)
    sensor.forget(np.arange(n_copies))
    shape = (len(steps), n_copies, task.spec.n_agents, len(sensor.features))
    out = np.full(shape, np.nan, dtype=np.float32)
    for step, row in zip(steps, out, strict=True):
        sensor.observe(step, np.ones(n_copies, dtype=np.bool_), row)
    return out


def test_an_echo_is_a_numbered_group_with_a_flag() -> None:
    features = (
        Feature("own.x", "position"),
        *numbered("beam", 2, [Feature("distance", "range"), Feature("robot", "flag")]),
        *numbered("preview", 2, vector("d", "position")),  # no flag: always there
        *numbered("cell", 1, [Feature("robot", "flag")]),
    )
    assert echoes_of(features).tolist() == [[1, 3], [3, 5], [9, 10]]
    assert echoes_of(()).shape == (0, 2)


@given(
    kind=st.sampled_from(["lidar", "occupancy"]),
    seed=st.integers(0, 2**32),
    time=st.integers(0, 200),
    dropout=st.sampled_from([0.0, 0.3, 1.0]),
    noise=st.sampled_from([0.0, 0.02, 3.0]),
    has_bodies=st.booleans(),
)
def test_noise_and_losses_of_echoes_equal_their_numpy_twin(
    scenes: Any, kind: str, seed: int, time: int, dropout: float, noise: float, has_bodies: bool
) -> None:
    worsened = {"kind": kind, "noise": {"range": noise}, "dropout": dropout}
    task = scenes.task(worsened, has_bodies=has_bodies)
    step = scenes.step(task, 2, seed, time)
    worse = observe(task, [step])[0]
    clean = observe(scenes.task({"kind": kind}, has_bodies=has_bodies), [step])[0]
    features = Sensor(task, 1).features
    is_flag = np.array([f.kind == "flag" for f in features])
    std, echoes = noise / getattr(task.spec.observation, "range", 1.0), echoes_of(features)
    for b, i in np.ndindex(2, 4):
        counters = (STREAMS["sensor"], time, i)
        draws = normal(derive(step.seeds[b], *counters, 0, np.arange(len(features))))
        lots = uniform(derive(step.seeds[b], *counters, 1, np.arange(len(echoes))))
        expected = clean[b, i].astype(np.float64)
        for (first, last), lot in zip(echoes, lots, strict=True):
            group = slice(first, last)
            if not clean[b, i, group][is_flag[group]].any():
                continue
            noisy = np.clip(expected[group] + std * draws[group], 0, 1)
            lost = np.where(is_flag[group], 0, 1)
            kept = np.where(is_flag[group], expected[group], noisy)
            expected[group] = lost if lot < dropout else kept
        np.testing.assert_array_equal(worse[b, i], expected.astype(np.float32))


@pytest.mark.parametrize("kind", ["lidar", "occupancy"])
def test_echoes_are_lost_independently_at_their_rate(scenes: Any, kind: str) -> None:
    task = scenes.task({"kind": kind, "dropout": 0.25})
    step = scenes.step(task, 1, 3)
    same = [step._replace(times=np.array([t])) for t in range(2000)]
    worse, clean = observe(task, same)[:, 0], observe(scenes.task({"kind": kind}), same[:1])[0, 0]
    features = Sensor(task, 1).features
    flags = np.array([f.kind == "flag" for f in features])
    lost = []
    for first, last in echoes_of(features):
        group = np.arange(first, last)[flags[first:last]]
        there = [i for i in range(4) if clean[i, group].any()]
        lost += [~worse[:, i, group].any(axis=1) for i in there]
    rates = np.mean(lost, axis=1)
    assert abs(rates.mean() - 0.25) < 0.02
    assert rates.std() < 0.02
    assert abs(np.corrcoef(lost[0], lost[1])[0, 1]) < 0.1


def test_a_lost_beam_reads_one_and_no_hit(scenes: Any) -> None:
    task = scenes.task({"kind": "lidar", "dropout": 1.0, "noise": LOUD})
    beams = observe(task, [scenes.step(task, 2, 0)])[0, ..., 5:].reshape(-1, 4)
    np.testing.assert_array_equal(beams, np.tile([1, 0, 0, 0], (len(beams), 1)))


@given(
    delay=st.integers(0, 4),
    stack=st.integers(1, 4),
    active=st.lists(st.lists(st.booleans(), min_size=3, max_size=3), min_size=1, max_size=9),
    restarts=st.lists(st.integers(0, 8), max_size=3),
)
def test_history_equals_a_list_of_frames(
    delay: int, stack: int, active: list[list[bool]], restarts: list[int]
) -> None:
    history = History((3, 2, 4), delay, stack)
    past: list[list[Float]] = [[], [], []]
    rng = np.random.default_rng(0)
    for time, flags in enumerate(active):
        if time in restarts:
            history.forget(np.array([1]))
            past[1] = []
        frame = rng.random((3, 2, 4), dtype=np.float32)
        out = np.full((3, 2, 4 * stack), np.nan, dtype=np.float32)
        history.exchange(frame, np.array(flags), out)
        for b, is_active in enumerate(flags):
            if not is_active:
                assert np.isnan(out[b]).all()
                continue
            past[b].append(frame[b])
            frames = [past[b][max(len(past[b]) - 1 - delay - k, 0)] for k in range(stack)]
            np.testing.assert_array_equal(out[b], np.concatenate(frames, axis=1))


@pytest.mark.parametrize("kind", KINDS)
def test_late_frames_are_those_that_were_sensed(scenes: Any, kind: str) -> None:
    """Delay and stacking move worsened frames about; they draw nothing anew."""
    worse = {"kind": kind, "noise": LOUD, "dropout": 0.2}
    now, late = scenes.task(worse), scenes.task({**worse, "delay": 2, "stack": 3})
    steps = [scenes.step(now, 2, 7, time) for time in range(8)]
    for t, step in enumerate(steps):
        steps[t] = step._replace(seeds=steps[0].seeds)
    frames, stacked = observe(now, steps), observe(late, steps)
    size = frames.shape[-1]
    for t in range(8):
        for k in range(3):
            expected = frames[max(t - 2 - k, 0)]
            np.testing.assert_array_equal(stacked[t, ..., k * size : (k + 1) * size], expected)


def test_without_modifiers_nothing_is_remembered_or_drawn(scenes: Any) -> None:
    sensor = Sensor(scenes.task({"kind": "lidar"}), 8)
    assert sensor._history is None
    assert sensor._measured is None
    assert sensor._echoes is None
    assert sensor._known is None
    assert sensor._frame.size == 0
