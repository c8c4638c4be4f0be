"""MAPPO: advantages by hand, inputs, and learning."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.online_algos.mappo import MAPPO, Config, generalized_advantages, own_first_states
from swarmdata.registry import make_env
from swarmdata.spec import TaskSpec

SMALL = Config(n_frames=1024, n_copies=4, n_steps=16, hidden=16, minibatch=64)


def advantages_of(terminated: bool, cut: bool) -> np.ndarray:
    """Two steps of one copy and one robot; the first step may end an episode."""
    rewards = np.array([1.0, 2.0], np.float32).reshape(2, 1, 1)
    values = np.array([10.0, 20.0], np.float32).reshape(2, 1, 1)
    next_values = np.array([7.0, 30.0], np.float32).reshape(2, 1, 1)  # 7: the episode's last state
    terminations = np.array([[terminated], [False]])
    ended = np.array([[terminated or cut], [False]])
    found = generalized_advantages(rewards, values, next_values, terminations, ended, 0.5, 0.5)
    return found[:, 0, 0]


def test_advantages_flow_inside_an_episode() -> None:
    second = 2 + 0.5 * 30 - 20
    np.testing.assert_allclose(
        advantages_of(False, False), [1 + 0.5 * 7 - 10 + 0.25 * second, second]
    )


def test_truncation_bootstraps_but_nothing_crosses_the_end() -> None:
    np.testing.assert_allclose(advantages_of(False, True), [1 + 0.5 * 7 - 10, -3.0])


def test_termination_stops_the_bootstrap() -> None:
    np.testing.assert_allclose(advantages_of(True, False), [1 - 10, -3.0])


def test_each_robot_sees_its_own_state_first() -> None:
    step = make_env(TaskSpec(), 2).reset(np.arange(2, dtype=np.uint64))
    views = own_first_states(step).reshape(2, 4, 4, 8)
    rows = step.states.reshape(2, 4, 8)
    for robot in range(4):
        np.testing.assert_array_equal(views[:, robot], np.roll(rows, -robot, axis=1))


def test_contact_costs_ramp_up_and_lower_only_touching_robots() -> None:
    run = MAPPO(make_env(TaskSpec(), 4), SMALL, 0)
    step = run.env.step(np.zeros((4, 4, 2)))
    step.events[0, 1] = (1, 0, 1, 0)
    before = run._train_rewards(step)
    run.frames = SMALL.n_frames
    after = run._train_rewards(step)
    assert after[0, 1] < before[0, 1]
    np.testing.assert_array_equal(after[1:], before[1:])


def test_a_restored_run_continues_with_the_same_numbers() -> None:
    run = MAPPO(make_env(TaskSpec(), 4), SMALL, 3)
    run.update()
    saved = run.state_dict()
    other = MAPPO(make_env(TaskSpec(), 4), SMALL, 3)
    other.update()
    other.update()
    other.load_state_dict(saved)
    run.load_state_dict(saved)
    assert run.update() == other.update()
    for (a, b), (c, d) in zip(run.actor_layers(), other.actor_layers(), strict=True):
        np.testing.assert_array_equal(a, c)
        np.testing.assert_array_equal(b, d)


@pytest.mark.learns
def test_two_robots_learn_to_reach_their_goals() -> None:
    nothing = {"circles": 1, "boxes": 0, "corners": 0, "pockets": 0}
    spec = TaskSpec.parse({"obstacles": nothing, "team": [{"count": 2}]})
    run = MAPPO(make_env(spec, 64), Config(n_frames=400_000, hidden=32), 0)
    while run.progress < 1:
        run.update()
    step = run.env.reset(np.arange(64, dtype=np.uint64))
    while not step.ended.all():
        import torch

        with torch.inference_mode():
            step = run.env.step(run.actor(torch.from_numpy(run.inputs(step)[0])).numpy())
    assert step.successes.mean() > 0.8
