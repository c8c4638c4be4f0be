"""Noise and losses of echoes against their NumPy twin; delay and stacking."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.numerics.random import STREAMS, derive, normal, uniform
from swarmdata.perception.sensing.modifiers import History, echoes_of
from swarmdata.perception.sensing.sensor import Sensor
from swarmdata.types import Float
from tests.perception.sensing import scenes


@given(
    kind=st.sampled_from(["lidar", "occupancy"]),
    seed=st.integers(0, 2**32),
    time=st.integers(0, 200),
    dropout=st.sampled_from([0.0, 0.3, 1.0]),
    noise=st.sampled_from([0.0, 0.02, 3.0]),
    has_bodies=st.booleans(),
)
def test_noise_and_losses_of_echoes_equal_their_numpy_twin(
    kind: str, seed: int, time: int, dropout: float, noise: float, has_bodies: bool
) -> None:
    worsened = {"kind": kind, "noise": {"range": noise}, "dropout": dropout}
    task = scenes.task(worsened, has_bodies=has_bodies)
    step = scenes.step(task, 2, seed, time)
    worse = scenes.observe(task, step)
    clean = scenes.observe(scenes.task({"kind": kind}, has_bodies=has_bodies), step)
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
