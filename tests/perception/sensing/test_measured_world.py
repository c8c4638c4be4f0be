"""What robots measure, against a NumPy twin: features see the measured world and nothing else."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.interfaces import Task
from swarmdata.numerics.episode_draws import drawn_values
from swarmdata.numerics.random import STREAMS, derive, normal, uniform
from swarmdata.perception.sensing.sensor import Sensor
from swarmdata.registry.components import make_env
from swarmdata.specs.state_layout import BODY, N_COLUMNS
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Seeds, Step
from tests.perception.sensing import scenes

KINDS = ("state", "lidar", "bearing", "occupancy")
LOUD = {"position": 0.05, "velocity": 0.04, "direction": 0.03, "range": 0.02}
OWN, SEEN, MISSED = 2, 3, 4


class Twin:
    """One robot's measurement of one copy in plain NumPy."""

    def __init__(self, task: Task, step: Step, robot: int) -> None:
        model = task.spec.observation
        self.noise, self.kind, self.n = model.noise, model.kind, task.spec.n_agents
        self.robot = robot
        self.arms = [
            p.half_length if p.shape == "circle" else np.hypot(p.half_length, p.half_width)
            for p in task.movables
        ]
        self.bits = derive(step.seeds[0], STREAMS["sensor"], step.times[0], robot)
        self.state, self.layout = step.states[0].astype(float), step.layouts[0].astype(float)

    def draw(self, bits: Seeds, k: int) -> float:
        return float(normal(derive(bits, k))[0])

    def turned(self, bits: Seeds) -> complex:
        """A rotation by 2 atan(std z / 2)."""
        half = 0.5 * self.noise.direction * self.draw(bits, 4)
        return complex(1, half) / complex(1, -half)

    def own(self) -> Double:
        bits = derive(self.bits, OWN)
        row = self.state[N_COLUMNS * self.robot :][:N_COLUMNS].copy()
        for c, std in enumerate([self.noise.position] * 2 + [self.noise.velocity] * 2):
            row[c] += std * self.draw(bits, c)
        heading = complex(row[4], row[5]) * self.turned(bits)
        row[4:6] = heading.real, heading.imag
        return row.astype(np.float32).astype(float)

    def world(self) -> tuple[Double, Double]:
        """States [S] and layout [M, 8]."""
        truth, own = self.state[N_COLUMNS * self.robot :][:N_COLUMNS], self.own()
        error = 1 + 0j if self.kind == "state" else self.turned(derive(self.bits, OWN))
        state, layout = self.state.copy(), self.layout.copy()
        state[N_COLUMNS * self.robot :][:N_COLUMNS] = own
        starts = [N_COLUMNS * j for j in range(self.n)]
        starts += [N_COLUMNS * self.n + len(BODY) * j for j in range(len(self.arms))]
        for k, at in enumerate(starts):
            if k == self.robot:
                continue
            bits, row = derive(derive(self.bits, SEEN), k), self.state[at:]
            d = complex(*(row[:2] - truth[:2]))
            if self.kind == "bearing" and k < self.n:
                measured = max(abs(d) + self.noise.range * self.draw(bits, 6), 0)
                d *= self.turned(bits) * measured / abs(d)
            else:
                d += self.noise.position * complex(self.draw(bits, 0), self.draw(bits, 1))
            v = complex(*(row[2:4] - truth[2:4]))
            v += self.noise.velocity * complex(self.draw(bits, 2), self.draw(bits, 3))
            p, v = complex(*own[:2]) + error * d, complex(*own[2:4]) + error * v
            axis = complex(*row[4:6]) * self.turned(bits) * error
            state[at : at + 6] = p.real, p.imag, v.real, v.imag, axis.real, axis.imag
            if k >= self.n:
                rate = self.noise.velocity / self.arms[k - self.n]
                state[at + 6] += rate * self.draw(bits, 5)
        for m, row in enumerate(self.layout):
            bits = derive(derive(self.bits, SEEN), len(starts) + m)
            d = complex(*(row[1:3] - truth[:2]))
            d += self.noise.position * complex(self.draw(bits, 0), self.draw(bits, 1))
            p = complex(*own[:2]) + error * d
            axis = complex(*row[3:5]) * self.turned(bits) * error
            layout[m, 1:5] = p.real, p.imag, axis.real, axis.imag
        return state, layout

    def missed(self, dropout: float) -> tuple[list[int], list[int]]:
        """Other robots and obstacles that are not seen."""
        chance, first = derive(self.bits, MISSED), self.n + len(self.arms)
        robots = [j for j in range(self.n) if uniform(derive(chance, j))[0] < dropout]
        rows = range(len(self.layout))
        return robots, [m for m in rows if uniform(derive(chance, first + m))[0] < dropout]


@given(
    kind=st.sampled_from(KINDS),
    seed=st.integers(0, 2**32),
    time=st.integers(0, 200),
    noise=st.sampled_from([LOUD, {"position": 0.2}, {"direction": 0.5}, {"velocity": 0.1}]),
    has_bodies=st.booleans(),
)
def test_a_noisy_observation_is_the_exact_one_of_the_measured_world(
    kind: str, seed: int, time: int, noise: dict[str, float], has_bodies: bool
) -> None:
    """Lidar beams and who is hidden follow from the true world: beams have noise of their own."""
    noise = {**noise, "range": 0.0} if kind == "lidar" else noise
    options: dict[str, Any] = {"has_bodies": has_bodies, "has_features": True, "n_agents": 2}
    task = scenes.task({"kind": kind, "noise": noise}, **options)
    exact = scenes.task({"kind": kind}, **options)
    step = scenes.step(task, 1, seed, time)
    if kind == "bearing":  # nothing that hides the other robot
        step = step._replace(layouts=step.layouts + np.float32(100) * (np.arange(8) == 1))
        step.states[:, N_COLUMNS * 2 :: 7] += 100
    (found,), (known,) = scenes.run(task, [step])
    clean = scenes.observe(exact, step)
    for i in range(2):
        twin = Twin(task, step, i)
        np.testing.assert_allclose(known[0, i], twin.own(), atol=1e-6)
        state, layout = (array.astype(np.float32)[None] for array in twin.world())
        expected = scenes.observe(exact, step._replace(states=state, layouts=layout))
        beams = slice(5, 5 + 16 * (4 + has_bodies)) if kind == "lidar" else slice(0, 0)
        expected[0, i, beams] = clean[0, i, beams]
        assert np.mean(~np.isclose(found[0, i], expected[0, i], atol=3e-6)) < 0.02  # a cell's edge


@pytest.mark.parametrize("kind", ["state", "bearing"])
@given(seed=st.integers(0, 2**32), dropout=st.sampled_from([0.2, 0.7, 1.0]))
def test_what_is_missed_is_not_there(kind: str, seed: int, dropout: float) -> None:
    """The next nearest takes its slot, so that no gap tells of it."""
    task = scenes.task({"kind": kind, "dropout": dropout}, n_agents=3)
    exact = scenes.task({"kind": kind}, n_agents=3)
    step = scenes.step(task, 1, seed)
    if kind == "bearing":  # nothing that hides a robot
        step = step._replace(layouts=step.layouts + np.float32(100) * (np.arange(8) == 1))
        step.states[0, ::N_COLUMNS] = 0.3, 0.1, 0.9
        step.states[0, 1::N_COLUMNS] = 0.2, 0.8, -0.4
    found = scenes.observe(task, step)
    for i in range(3):
        robots, obstacles = Twin(task, step, i).missed(dropout)
        far = step._replace(states=step.states.copy(), layouts=step.layouts.copy())
        far.states[0, [N_COLUMNS * j for j in robots if j != i]] = 1e6
        far.layouts[0, obstacles, 1] = 1e6
        expected = scenes.observe(exact, far)
        expected[abs(expected) > 1e5] = np.nan  # slots of the far ones are empty
        names = [feature.slot for feature in Sensor(task, 1).features]
        for slot in set(names) - {"own", "target"}:
            columns = np.array([name == slot for name in names])
            if np.isnan(expected[0, i, columns]).any():
                expected[0, i, columns] = 0
        np.testing.assert_array_equal(found[0, i], expected[0, i])


def test_what_robots_know_of_themselves_is_late() -> None:
    task = scenes.task({"kind": "state", "delay": 2, "noise": LOUD})
    steps = [scenes.step(task, 2, 7, time) for time in range(6)]
    steps = [step._replace(seeds=steps[0].seeds) for step in steps]
    undelayed = scenes.task({"kind": "state", "noise": LOUD})
    now = [scenes.run(undelayed, [step])[1][0] for step in steps]
    for t, late in enumerate(scenes.run(task, steps)[1]):
        np.testing.assert_array_equal(late, now[max(t - 2, 0)])


@pytest.mark.parametrize("kind", KINDS)
def test_each_robot_draws_the_noise_of_its_sensors(kind: str) -> None:
    """A robot observes what it would with the drawn deviation in the model."""
    model = {"kind": kind}
    spec = TaskSpec.parse({"observation": model, "randomization": {"noise": [0.01, 0.3]}})
    seeds = np.arange(3, dtype=np.uint64)
    found = make_env(spec, 3).reset(seeds).observations
    drawn = drawn_values(spec, seeds)["noise"]
    for b in range(3):
        for i in (0, 3):
            noise = dict.fromkeys(LOUD, drawn[b, i].item())
            known = TaskSpec.parse({"observation": {**model, "noise": noise}})
            alone = make_env(known).reset(seeds[b : b + 1]).observations
            np.testing.assert_allclose(found[b, i], alone[0, i], rtol=1e-6, atol=1e-6)
    exact = make_env(TaskSpec.parse({"observation": model})).reset(seeds[:1]).observations
    assert not np.array_equal(exact[0], found[0])
