"""The channel against a slow one that looks back over the whole episode in every step."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.numerics.random import STREAMS, derive, uniform
from swarmdata.specs.sensing_models import Broadcast
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float
from tests.perception.comms.trajectories import make_spec, make_states, run

DROP, BURST, TIME_SLOT = 0, 1, 2
COLUMNS = {
    "pose": "x y ux uy",
    "pose_and_goal": "x y ux uy tx ty",
    "errand": "x y ux uy next_tx next_ty",
    "state": "x y vx vy ux uy",
}
ROW = ("x", "y", "vx", "vy", "ux", "uy", "tx", "ty")

broadcasts = st.fixed_dictionaries(
    {
        "payload": st.sampled_from([*COLUMNS, "learned"]),
        "message_size": st.integers(1, 3),
        "topology": st.sampled_from(["full", "nearest", "ring", "star"]),
        "n_nearest": st.integers(1, 4),
        "range": st.none() | st.floats(0.5, 4.0),
        "drop_probability": st.sampled_from([0.0, 0.3, 0.8, 1.0]),
        "bursts": st.none()
        | st.fixed_dictionaries(
            {
                "enter": st.sampled_from([0.0, 0.2, 1.0]),
                "leave": st.sampled_from([0.0, 0.3, 1.0]),
                "drop_probability": st.sampled_from([0.5, 1.0]),
            }
        ),
        "delay": st.integers(0, 4),
        "messages_per_step": st.none() | st.integers(1, 3),
        "bits": st.none() | st.sampled_from([1, 3, 24]),
        "slots_in_step": st.none() | st.integers(1, 6),
        "max_age": st.none() | st.integers(4, 6),
    }
)


class SlowChannel:
    """One episode of one copy; remembers nothing but the trajectory."""

    def __init__(self, spec: TaskSpec, seed: int, states: Float, actions: Float) -> None:
        assert isinstance(spec.communication, Broadcast)
        self.spec, self.model, self.seed = spec, spec.communication, np.uint64(seed)
        self.n = spec.n_agents
        self.rows = states[:, : 8 * self.n].reshape(-1, self.n, 8)
        self.actions = actions
        self.arrivals = [self.links(t) for t in range(len(self.rows))]
        self.names = COLUMNS.get(self.model.payload, "").split()

    def luck(self, t: int, purpose: int, *counters: int) -> float:
        return float(uniform(derive(self.seed, STREAMS["channel"], t, purpose, *counters))[0])

    def value(self, t: int, j: int, name: str) -> float:
        if name.startswith("next_"):
            j, name = (j + 1) % self.n, name.removeprefix("next_")
        return float(self.rows[t, j, ROW.index(name)])

    def message(self, t: int, j: int) -> list[np.float32]:
        if self.model.payload == "learned":
            if t == 0:
                return [np.float32(0)] * self.model.message_size
            raw = [float(np.clip(v, -1, 1)) for v in self.actions[t, j, 2:]]
            spans = [1.0] * len(raw)
        else:
            raw = [self.value(t, j, name) for name in self.names]
            spans = [self.span(j, name) for name in self.names]
        return [np.float32(self.quantized(v, span)) for v, span in zip(raw, spans, strict=True)]

    def span(self, j: int, name: str) -> float:
        if name in {"vx", "vy"}:
            return self.spec.robots[j].max_speed
        if name in {"ux", "uy"}:
            return 1.0
        return (self.spec.arena.width if name[-1] == "x" else self.spec.arena.height) / 2

    def quantized(self, value: float, span: float) -> float:
        if self.model.bits is None:
            return value
        width = 2 * span / 2**self.model.bits
        cell = math.floor((value + span) / width)
        return -span + (min(max(cell, 0), 2**self.model.bits - 1) + 0.5) * width

    def hears(self, t: int, i: int) -> list[int]:
        """Senders that robot i can hear, by topology and range."""
        others = [j for j in range(self.n) if j != i]
        square = {
            j: sum((self.value(t, j, a) - self.value(t, i, a)) ** 2 for a in "xy") for j in others
        }
        if self.model.topology == "nearest":
            others = sorted(sorted(others, key=lambda j: (square[j], j))[: self.model.n_nearest])
        if self.model.topology == "ring":
            others = [j for j in others if (i - j) % self.n in {1, self.n - 1}]
        if self.model.topology == "star":
            others = [j for j in others if 0 in {i, j}]
        limit = self.model.range
        return [j for j in others if limit is None or square[j] <= limit**2]

    def links(self, t: int) -> set[tuple[int, int]]:
        """Links (receiver, sender) over which the message of step t gets through."""
        through: set[tuple[int, int]] = set()
        n_slots, limit = self.model.slots_in_step, self.model.messages_per_step
        slot = [int(self.luck(t, TIME_SLOT, j) * (n_slots or 1)) for j in range(self.n)]
        for i in range(self.n):
            audible = taken = self.hears(t, i)
            if limit is not None and len(audible) > limit:
                turns = [(t * limit + k) % len(audible) for k in range(limit)]
                taken = [audible[turn] for turn in turns]
            for j in taken:
                rivals = [k for k in (*audible, i) if k != j and slot[k] == slot[j]]
                if not (n_slots and rivals) and not self.is_dropped(t, i, j):
                    through.add((i, j))
        return through

    def is_dropped(self, t: int, i: int, j: int) -> bool:
        chance, bursts = self.model.drop_probability, self.model.bursts
        if bursts is not None and self.is_bad(t, i, j):
            chance = 1.0 - (1.0 - chance) * (1.0 - bursts.drop_probability)
        return self.luck(t, DROP, j, i) < chance

    def is_bad(self, t: int, i: int, j: int) -> bool:
        bursts, luck = self.model.bursts, self.luck(t, BURST, j, i)
        assert bursts is not None
        if t == 0:
            return luck * (bursts.enter + bursts.leave) < bursts.enter
        return luck >= bursts.leave if self.is_bad(t - 1, i, j) else luck < bursts.enter

    def newest(self, t: int, i: int, j: int) -> int | None:
        """When the newest message of j that i holds at time t was sent."""
        times = range(t - self.model.delay, -1, -1)
        return next((s for s in times if (i, j) in self.arrivals[s]), None)

    def slots(self, t: int, i: int) -> list[float]:
        return [v for j in range(self.n) if j != i for v in self.slot(t, i, j)]

    def slot(self, t: int, i: int, j: int) -> list[float]:
        sent_at = self.newest(t, i, j)
        limit = self.model.max_age
        if sent_at is None or (limit is not None and t - sent_at > limit):
            return [0.0] * (len(self.message(0, j)) + 3)
        values = [float(v) for v in self.message(sent_at, j)]
        heading = complex(self.value(t, i, "ux"), -self.value(t, i, "uy"))
        for c in range(0, len(self.names), 2):
            vector = complex(values[c], values[c + 1])
            if self.names[c] in {"x", "tx", "next_tx"}:
                vector -= complex(self.value(t, i, "x"), self.value(t, i, "y"))
            if self.spec.observation.kind != "state":
                vector *= heading
            if self.names[c] == "next_tx" and i != (j + 1) % self.n:
                vector = 0j
            values[c], values[c + 1] = vector.real, vector.imag
        return [*values, min(t - sent_at, 20) / 20, 1.0, j / max(self.n - 1, 1)]


@pytest.mark.slow
@settings(max_examples=max(60, settings().max_examples))  # many parts to combine
@given(
    broadcasts,
    st.integers(2, 6),
    st.sampled_from(["state", "lidar"]),
    st.integers(0, 2**32),
    st.integers(2, 10),
)
def test_equals_the_slow_channel(
    model: dict[str, Any], n: int, observation: str, draw: int, n_steps: int
) -> None:
    spec = make_spec(n, observation, **model)
    rng = np.random.default_rng(draw)
    seeds = rng.integers(0, 2**64, 2, dtype=np.uint64)
    states = make_states(rng, n_steps, 2, n)
    actions = rng.uniform(-1.2, 1.2, (n_steps, 2, n, spec.action_size))
    log = run(spec, states, seeds, actions)

    for e in range(2):
        slow = SlowChannel(spec, seeds[e], states[:, e], actions[:, e].astype(np.float32))
        for t in range(n_steps):
            np.testing.assert_array_equal(
                log.sent[t, e], [slow.message(t, j) for j in range(n)], strict=False
            )
            for i in range(n):
                np.testing.assert_allclose(
                    log.slots[t, e, i], slow.slots(t, i), rtol=1e-6, atol=1e-6
                )
                for j in range(n):
                    sent_at = slow.newest(t, i, j)
                    arrived = t - slow.model.delay
                    assert log.ages[t, e, i, j] == (255 if sent_at is None else t - sent_at)
                    assert log.delivered[t, e, i, j] == (
                        arrived >= 0 and (i, j) in slow.arrivals[arrived]
                    )


def test_out_has_no_columns_for_a_robot_alone() -> None:
    spec = make_spec(1)
    log = run(spec, np.zeros((2, 1, 8), dtype=np.float32), np.zeros(1, dtype=np.uint64))

    assert log.slots.shape == (2, 1, 1, 0)
    assert not log.delivered.any()
