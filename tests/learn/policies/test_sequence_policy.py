"""Policies that decide in order act as they were trained, in any frame, and are kept apart."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import PolicyFitError, SchemaError
from swarmdata.learn.deployment.robot_step import robot_step
from swarmdata.learn.evaluation.transitions import actions_of
from swarmdata.learn.memory.sequence_networks import Mixture, told_actions
from swarmdata.learn.training.training_data import framed
from swarmdata.perception.frames import Frame
from swarmdata.registry.components import make_env
from tests.learn.policies.recurrent_training import oryx, played, steps_of


@pytest.mark.parametrize("in_frame", [False, True])
def test_acting_step_by_step_is_the_window_from_the_start(
    data: Dataset, frame: Frame, in_frame: bool
) -> None:
    """Given what the robots did choose, training's outputs have their actions as modes."""
    used = frame if in_frame else None
    algorithm, observations = oryx(data, used), np.array(data[0].observations)
    sampler = framed(data, used).sampler(1, horizon=4, burn_in=8, seed=0)
    batch = sampler.gather(np.array([[8]])).to_torch()  # steps 0 to 11, of which 8 to 11 count
    assert batch.mask.all()
    steps = steps_of(observations, make_env(data.task, 1).reset(np.zeros(1, "u8")))
    actions = played(algorithm.policy(0), steps[:12])
    local = actions.astype(np.float64)
    if used is not None:
        local = used.to_local(observations[:12], actions)
    with torch.no_grad():
        chosen = replace(batch, actions=torch.from_numpy(local.astype(np.float32))[None, None])
        _, outputs = algorithm.actor.along(chosen)
    config = algorithm.config
    wanted = Mixture.of(outputs, config.n_components).mode(config.deviation)[0].numpy()
    if used is not None:
        wanted = wanted / np.maximum(np.linalg.norm(wanted, axis=-1, keepdims=True), 1)
    np.testing.assert_allclose(local[8:], wanted, atol=1e-4)


def test_robots_hear_those_before_them(data: Dataset) -> None:
    """What robot 2 observes changes what it does, and what robot 3 does, which hears it."""
    step = make_env(data.task, 3).reset(np.arange(3, dtype=np.uint64))
    observations = step.observations.copy()
    observations[:, 2] += 0.5
    for joint in (True, False):
        policy = oryx(data, joint=joint).policy(0)
        acted = []
        for seen in (step, step._replace(observations=observations)):
            policy.reset(seen, np.arange(3))
            acted.append(policy.act(seen))
        changed = (acted[0] != acted[1]).any((0, 2))
        assert changed.tolist() == [False, False, True, joint]


def test_told_actions_are_turned_into_the_hearers_frame(data: Dataset, frame: Frame) -> None:
    observations = np.array(data[0].observations[:5])
    world = np.array(data[0].actions[:5]).clip(-0.7, 0.7)
    seen = torch.from_numpy(frame.inputs(observations)).double()
    told = told_actions(frame, seen, torch.from_numpy(frame.to_local(observations, world)))
    n_agents = world.shape[1]
    for i in range(n_agents):
        same = np.repeat(observations[:, i : i + 1], n_agents, 1)  # everyone in robot i's frame
        expected = frame.to_local(same, world)
        np.testing.assert_allclose(told[:, i, :, :2].numpy(), expected, atol=1e-6)
    own = told[:, range(n_agents), range(n_agents), 2:]
    torch.testing.assert_close(own, torch.tensor([1.0, 0.0]).double().expand_as(own))
    mixed = replace(frame, heading=0, holonomic=(1, 2, 3))  # robot 0 gets speed and turn rate
    local = torch.from_numpy(world).double()
    unturned = told_actions(mixed, seen, local)
    assert torch.equal(unturned[:, :, 0, :2], local[:, None, 0].expand(-1, n_agents, -1))
    assert torch.equal(unturned[:, :, 1:], told_actions(frame, seen, local)[:, :, 1:])


def test_what_needs_robots_that_act_alone_refuses_it(data: Dataset) -> None:
    policy = oryx(data).policy(0)
    with pytest.raises(PolicyFitError, match="acts for the whole team"):
        robot_step(policy, 4)
    with pytest.raises(PolicyFitError, match="SequencePolicy cannot be exported"):
        robot_step(oryx(data, joint=False).policy(0), 4)
    with pytest.raises(SchemaError, match="SequencePolicy has no `actions"):
        actions_of([policy], data)
