"""A team that avoids contacts keeps its commands in the open, and brakes before it would hit."""

from dataclasses import replace

import numpy as np
import pytest

from swarmdata.behavior_policies.navigation.episode_maps import primitives_of
from swarmdata.behavior_policies.navigation.robot_scales import Team
from swarmdata.errors import SpecError
from swarmdata.numerics.geometry import POCKET
from swarmdata.online_algos.imitation.avoiding_team import ActorTeam, AvoidingTeam, make_safe
from swarmdata.online_algos.mappo import MAPPO, MAPPOConfig
from swarmdata.online_algos.ppo.initial_weights import StartConfig
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.side_env import whole_of
from swarmdata.specs.task_spec import Robot, Role, TaskSpec
from swarmdata.types import EVENTS, Double, Float

SPEC = TaskSpec(horizon=20)
SMALL = MAPPOConfig(n_steps=1024, n_copies=4, rollout_steps=8, hidden=16, minibatch=64)
NOTHING = np.zeros((1, 0, 8), np.float32)
ARENA = np.array([2.0, 2.0])
OBSTACLE_EVENTS = [k for k, name in enumerate(EVENTS) if "obstacle" in name]


def safe(
    robots: list[list[float]],
    commands: list[list[float]],
    primitives: Float = NOTHING,
    margin: float = 0.02,
) -> Double:
    """Safe commands of robots among obstacles; x, y, vx, vy each."""
    states = np.zeros((1, 4, 4))
    states[0, :, :2] = [[-1.5, -1.5], [-1.5, 1.5], [1.5, -1.5], [1.5, 1.5]]  # the others, far away
    states[0, : len(robots)] = robots
    out = np.zeros((1, 4, 2))
    out[0, : len(commands)] = commands
    make_safe(states, Team.of(SPEC), ARENA, primitives, margin, out)
    return out[0, : len(commands)]


def made(spec: TaskSpec = SPEC, config: MAPPOConfig = SMALL) -> MAPPO:
    return MAPPO(make_env(spec, config.n_copies * 2), (0, 1), config)


def test_commands_in_the_open_stay_up_to_the_top_speed() -> None:
    np.testing.assert_allclose(safe([[0, 0, 0.3, 0]], [[0.5, 0.25]]), [[0.5, 0.25]])
    np.testing.assert_allclose(safe([[0, 0, 0, 0]], [[3.0, 4.0]]), [[0.6, 0.8]])


def test_a_robot_slows_down_before_a_wall_and_may_drive_along_it() -> None:
    (command,) = safe([[1.83, 0, 0.6, 0]], [[1.0, 0.5]])
    assert 0 <= command[0] < 0.15
    assert command[1] == pytest.approx(1 / np.sqrt(5))


def test_a_robot_in_a_pocket_slows_down_before_all_of_its_walls() -> None:
    pocket = np.array([[POCKET, 0.0, 0.0, 0.0, 1.0, 0.4, 0.4, 0.05]], dtype=np.float32)
    robot = [0.15, 0.18, 0.3, 0.3]  # in the corner of two walls, in which it drives
    (free,) = safe([robot], [[0.5, 0.5]])
    (kept,) = safe([robot], [[0.5, 0.5]], primitives_of(pocket)[None])
    np.testing.assert_allclose(free, 0.5)
    assert (np.abs(kept) < 0.2).all()


def test_two_robots_that_meet_both_turn_aside() -> None:
    commands = safe([[-0.2, 0, 0.6, 0], [0.2, 0.02, -0.6, 0]], [[1.0, 0.0], [-1.0, 0.0]])
    assert commands[0, 1] < -0.05
    assert commands[1, 1] > 0.05
    np.testing.assert_allclose(commands[0], -commands[1], atol=1e-9)


def test_each_seed_is_its_own_teacher() -> None:
    run = made()
    step = run.worlds.current_step
    teacher = AvoidingTeam(ActorTeam(run.actors.copy(), run.worlds), whole_of(run.worlds.env), 0.02)
    teacher.reset(step, np.arange(run.worlds.env.n_copies))
    actions = teacher.act(step)
    own = np.stack([run.policy(k).act(step) for k in (0, 1)])  # [K, K E, N, A]
    wanted = np.concatenate([own[0, :4], own[1, 4:]])
    assert actions.shape == wanted.shape
    # few robots are near anything at the start, and untrained actors want next to nothing
    assert np.median(np.abs(actions - wanted)) < 1e-6
    assert not np.allclose(own[0, :4], own[1, :4], atol=1e-6)


@pytest.mark.slow
def test_policies_can_be_their_own_teacher() -> None:
    start = StartConfig(policies="coop_nav-expert", avoidance=True, clone_rounds=1)
    run = made(config=replace(SMALL, hidden=128, start=start))
    assert run.prepare()
    step = make_env(SPEC, 16).reset(np.arange(16, dtype=np.uint64))
    started = made(config=replace(SMALL, hidden=128, start=replace(start, avoidance=False)))
    started.prepare()
    for k in (0, 1):
        ours, theirs = run.policy(k).act(step), started.policy(k).act(step)
        assert 0 < np.median(np.abs(ours - theirs)) < 0.1


def test_a_teacher_is_kept_from_contacts_in_the_episodes_that_were_reset() -> None:
    spec = preset("search")
    env, copies = make_env(spec, 8), np.arange(8)
    teacher = AvoidingTeam(make_policy("scripted", spec), env, 0.04)
    step = env.reset(copies.astype(np.uint64))
    teacher.reset(step, copies)
    for _ in range(60):
        step = env.step(teacher.act(step))
        assert not step.events[..., OBSTACLE_EVENTS].any()
        ended = np.flatnonzero(step.ended)
        if len(ended):
            step = env.reset(100 + ended.astype(np.uint64), ended)
            teacher.reset(step, ended)
        teacher.reset(step, copies)  # as without a memory: layouts that are known are kept


@pytest.mark.parametrize("robot", [Robot(dynamics="unicycle"), Robot(command="acceleration")])
def test_other_robots_are_refused(robot: Robot) -> None:
    run = made(
        SPEC.model_copy(update={"team": (Role(robot=robot),)}), replace(SMALL, frame="world")
    )
    with pytest.raises(SpecError, match="holonomic velocity commands"):
        AvoidingTeam(ActorTeam(run.actors, run.worlds), whole_of(run.worlds.env), 0.02)
