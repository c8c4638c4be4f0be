"""The formation task: success by hand, metrics, features, contract."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from swarmdata.envs.formation.formation import Formation
from swarmdata.envs.formation.formation_rules import FormationRules
from swarmdata.envs.physics.kinematic import KinematicBackend
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.registry.components import make_env, make_policy, make_task
from swarmdata.registry.presets import preset
from swarmdata.rollouts.metrics import episode_metrics
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY, VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.task_contract import check_task
from swarmdata.types import Double, Float, Seeds, Step
from tests.envs.worlds import NO_OBSTACLES, rules_of, seeds_of


def spec_of(**rules: Any) -> TaskSpec:
    return rules_of(preset("formation"), **rules)


def open_spec(horizon: int = 40, **rules: Any) -> TaskSpec:
    """No obstacles, no contact costs: what remains is the task's own reward."""
    rewards = dict.fromkeys(("robot_contact", "obstacle_contact", "robot_collision",
                             "obstacle_collision", "proximity"), 0.0)  # fmt: skip
    spec = spec_of(**{"blocked": (0.0, 0.0), "rewards": rewards, **rules})
    return spec.with_updates(obstacles=NO_OBSTACLES, horizon=horizon)


def toward_slots(step: Step, spec: TaskSpec, gain: float = 2.0) -> Double:
    """A proportional command with the reference's velocity on top."""
    n = spec.n_agents
    robots = robots_of(step.states, n).astype(np.float64)
    drift = step.states[:, None, N_COLUMNS * n + 2 : N_COLUMNS * n + 4].astype(np.float64)
    wish = gain * (robots[..., [TX, TY]] - robots[..., [X, Y]]) + drift
    return np.asarray(wish / spec.robots[0].max_speed)


def play(env: TaskEnv, ids: Seeds, n_steps: int, noise: float = 0.0) -> list[Step]:
    rng = np.random.default_rng(0)
    steps = [env.reset(ids)]
    for _ in range(n_steps):
        commands = toward_slots(steps[-1], env.spec)
        steps.append(env.step(commands + noise * rng.normal(size=commands.shape)))
    return steps


def extra(step: Step, task: Formation, name: str) -> Float:
    return np.asarray(
        step.states[
            :, N_COLUMNS * task.spec.n_agents + [column.name for column in task.extras].index(name)
        ]
    )


@pytest.mark.parametrize("slots", ["fixed", "assigned"])
@pytest.mark.parametrize("shape", ["line", "circle", "wedge", "column"])
def test_the_contract_for_every_shape_and_acceleration(shape: str, slots: str) -> None:
    team = [{"count": 3, "robot": {"command": "acceleration"}}, {"name": "big", "count": 1}]
    check_task(make_env, spec_of(shape=shape, slots=slots).with_updates(team=team), n_steps=20)


def test_a_task_without_previews_or_with_one_robot() -> None:
    check_task(make_env, spec_of(preview=[]), n_steps=20)
    alone = spec_of(blocked=(0.0, 0.3)).with_updates(team=[{"count": 1}])
    check_task(make_env, alone, n_steps=20)


@pytest.mark.parametrize("slots", ["fixed", "assigned"])
def test_the_count_of_steps_follows_its_formula(slots: str) -> None:
    spec = open_spec(horizon=80, slots=slots)
    env = TaskEnv(make_task(spec), 6)
    task, rules = env.task, spec.rules
    assert isinstance(task, Formation)
    assert isinstance(rules, FormationRules)
    n_formed = 0
    for before, step in pairwise(play(env, np.arange(6, dtype=np.uint64), 80, noise=0.3)):
        active = ~before.ended
        robots = robots_of(step.states, spec.n_agents).astype(np.float64)
        away = np.linalg.norm(robots[..., [TX, TY]] - robots[..., [X, Y]], axis=-1)
        rmse = np.sqrt((away * away).mean(axis=1))
        held, old = extra(step, task, "steps_held"), extra(before, task, "steps_held")
        clear = active & (np.abs(rmse - rules.tolerance) > 1e-6)
        np.testing.assert_array_equal((held - old)[clear], (rmse <= rules.tolerance)[clear])
        np.testing.assert_array_equal(step.successes[active], held[active] >= 48)
        n_formed += int((held > old).sum())
    assert n_formed > 50, "nobody was in formation: this shows little"


def test_the_reference_moves_as_it_says_and_previews_come_true() -> None:
    spec = open_spec(horizon=60, preview=(0.5, 2.0))
    env = TaskEnv(make_task(spec), 2, KinematicBackend)
    steps, task = play(env, seeds_of(1, 2), 30), env.task
    assert isinstance(task, Formation)
    place = np.array([[extra(s, task, f"reference_{c}") for c in "xy"] for s in steps])  # [T, 2, E]
    velocity = np.array([[extra(s, task, f"reference_v{c}") for c in "xy"] for s in steps])
    middle = (velocity[1:] + velocity[:-1]) / 2
    np.testing.assert_allclose(np.diff(place, axis=0) / 0.1, middle, atol=2e-3)
    for k, later in enumerate((5, 20)):
        for c in ("x", "y", "ux", "uy"):
            told = [extra(s, task, f"preview_{k}_{c}") for s in steps[: 31 - later]]
            came = [extra(s, task, f"reference_{c}") for s in steps[later:]]
            np.testing.assert_allclose(told, came, atol=1e-5)


def put_in_slots(env: TaskEnv, ids: Seeds, away: Double) -> Step:
    """Starts episodes with every robot `away` [N, 2] from its slot, moving with nothing."""
    step = env.reset(ids)
    robots = robots_of(step.states, env.spec.n_agents)
    robots[..., [X, Y]] = robots[..., [TX, TY]] + away
    backend = env._blocks[0]._world._backend
    assert isinstance(backend, KinematicBackend)
    backend.motion.robots[..., :2] = robots[..., :2]
    return step


def test_one_robot_far_off_spoils_the_formation_and_steps_add_up_over_gaps() -> None:
    spec = open_spec(horizon=20, slots="fixed", hold_fraction=0.3, reference_speed=0.05)
    env = TaskEnv(make_task(spec), 1, KinematicBackend)
    away = np.zeros((4, 2))
    away[2] = [0.3, 0.0]  # root mean square 0.15 > 0.12
    step, task, held = put_in_slots(env, seeds_of(3), away), env.task, []
    assert isinstance(task, Formation)
    backend = env._blocks[0]._world._backend
    assert isinstance(backend, KinematicBackend)
    for t in range(12):
        if t in (3, 6, 8):  # robot 2 to its slot, away, and back
            shift = -0.3 if t != 6 else 0.3
            backend.motion.robots[0, 2, 0] += shift
        drift = step.states[:, None, 34:36].astype(np.float64)
        step = env.step(np.broadcast_to(drift / 0.6, (1, 4, 2)))
        held.append(int(extra(step, task, "steps_held")[0]))
        if step.ended[0]:
            break
    assert held == [0, 0, 0, 1, 2, 3, 3, 3, 4, 5, 6]
    assert step.successes[0]


def test_features_are_what_they_are_called() -> None:
    spec = open_spec(preview=(1.0,))
    env = TaskEnv(make_task(spec), 3, KinematicBackend)
    steps, task = play(env, seeds_of(1, 2, 3), 12), env.task
    assert isinstance(task, Formation)
    names = [feature.name for feature in task.features]
    out = np.zeros((3, 4, len(names)), dtype=np.float32)
    task.write_features(steps[2].states, steps[2].layouts, np.array([True, True, False]), out)
    assert not out[2].any(), "an inactive copy was written to"
    robots = robots_of(steps[2].states, 4).astype(np.float64)[:2]
    place, ref = robots[..., [X, Y]], steps[2].states[:2, None, 32:39].astype(np.float64)
    columns = {name: out[:2, :, k].astype(np.float64) for k, name in enumerate(names)}

    def pair(name: str) -> Double:
        return np.stack([columns[f"{name}_x"], columns[f"{name}_y"]], axis=-1)

    np.testing.assert_allclose(pair("reference.offset"), ref[..., :2] - place, atol=1e-6)
    np.testing.assert_allclose(pair("reference.velocity") - ref[..., 2:4], 0.0, atol=1e-6)
    np.testing.assert_allclose(pair("reference.heading") - ref[..., 4:6], 0.0, atol=1e-6)
    targets = [robots_of(step.states, 4)[:2, :, [TX, TY]].astype(np.float64) for step in steps]
    held = np.linalg.norm(targets[3] - targets[2], axis=-1) < 0.1  # same slot in the next step
    moving = (targets[3] - targets[2]) / 0.1 - robots[..., [VX, VY]]
    np.testing.assert_allclose(pair("slot.velocity")[held], moving[held], atol=5e-3)
    later = np.sort(targets[12].reshape(2, -1), axis=1)  # the same slots, whoever has them
    told = np.sort((pair("preview_0.offset") + place).reshape(2, -1), axis=1)
    np.testing.assert_allclose(told, later, atol=1e-5)


def test_metrics_by_hand() -> None:
    spec = open_spec(horizon=30)
    env = make_env(spec, 4)
    policy = make_policy("straight", spec)
    for episode in rollout(env, policy, np.arange(8, dtype=np.uint64)):
        robots = robots_of(episode.states[1:], 4).astype(np.float64)
        away = robots[..., [TX, TY]] - robots[..., [X, Y]]
        rmse = np.sqrt((np.linalg.norm(away, axis=-1) ** 2).mean(axis=1))
        centre = robots[..., [X, Y]].mean(axis=1) - episode.states[1:, 32:34]
        values = episode_metrics(episode, env.task)
        assert set(Formation.metrics) <= set(values)
        assert values["formation_rmse"] == pytest.approx(rmse.mean())
        assert values["time_in_formation"] == pytest.approx((rmse <= 0.12).mean())
        assert values["reference_error"] == pytest.approx(np.linalg.norm(centre, axis=1).mean())
