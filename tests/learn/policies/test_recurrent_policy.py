"""Policies with a memory act as they were trained, forget at a reset, and keep copies apart."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import BuildError, SchemaError
from swarmdata.learn.evaluation.transitions import actions_of
from swarmdata.learn.policies.drawn_policy import RecurrentFlowPolicy
from swarmdata.learn.policies.policy_file import save_policy
from swarmdata.learn.training.training_data import framed
from swarmdata.offline_algos.vdn import VDN, VDNConfig
from swarmdata.online_algos.runs.export_policy import export
from swarmdata.perception.frames import Frame
from swarmdata.registry.components import make_env
from swarmdata.types import Step
from tests.learn.policies.recurrent_training import (
    FLOW,
    MEMORY,
    bc,
    mac_flow,
    oryx,
    played,
    steps_of,
    trained,
)

Train = Callable[..., Any]

KINDS = pytest.mark.parametrize(
    "train",
    [bc, partial(mac_flow, redraw="episode"), oryx],
    ids=["policy", "flow policy", "in order"],
)
"""Of the flow, one noise for an episode: what changes its actions is the memory."""


@pytest.mark.parametrize(("in_frame", "output"), [(False, "tanh"), (True, "clip")])
def test_acting_step_by_step_is_the_window_from_the_start(
    data: Dataset, frame: Frame, in_frame: bool, output: Any
) -> None:
    used = frame if in_frame else None
    algorithm, episode = bc(data, used, output=output), data[0]
    sampler = framed(data, used).sampler(1, horizon=MEMORY["window"], burn_in=8, seed=0)
    batch = sampler.gather(np.array([[8]])).to_torch()  # steps 0 to 11, of which 8 to 11 count
    assert batch.mask.all()
    _, expected = algorithm.actor.along(batch)
    steps = steps_of(
        np.array(episode.observations), make_env(data.task, 1).reset(np.zeros(1, "u8"))
    )
    actions = played(algorithm.policy(0), steps[:12])[8:]
    wanted = expected[0].detach().clamp(-1, 1).numpy()
    if used is not None:
        wanted = used.to_world(np.array(episode.observations[8:12]), wanted).astype(np.float32)
        norm = np.maximum(np.linalg.norm(wanted, axis=-1, keepdims=True), 1)
        wanted = (wanted / norm).clip(-1, 1)
    np.testing.assert_allclose(actions, wanted, atol=1e-5)


@pytest.mark.parametrize(("regulariser", "parameters"), [("bc", "separate"), ("bcq", "shared")])
def test_choices_step_by_step_are_those_of_training(
    data: Dataset, regulariser: Any, parameters: Any
) -> None:
    config = VDNConfig(hidden=(8,), regulariser=regulariser, parameters=parameters, **MEMORY)
    algorithm: VDN = trained(VDN, config, data, None)
    sampler = data.sampler(1, horizon=4, burn_in=8, seed=0)
    networks = algorithm.networks
    with torch.no_grad():
        seen = networks.see(sampler.gather(np.array([[8]])).to_torch())
        weights = networks.act(networks.utilities(seen.features), networks.log_probs(seen.features))
    expected = networks.choices.to_actions(weights)[0].numpy()
    steps = steps_of(
        np.array(data[0].observations), make_env(data.task, 1).reset(np.zeros(1, "u8"))
    )
    policy = algorithm.policy(0)
    np.testing.assert_allclose(played(policy, steps[:12])[8:], expected, atol=1e-5)
    assert not policy.log_probs(steps[11], policy.act(steps[11])).any()
    with pytest.raises(SchemaError, match="policy with memory"):
        policy.log_probs(steps[0], expected[:1])


@KINDS
def test_it_remembers_until_it_is_reset(train: Train, data: Dataset) -> None:
    policy = train(data).policy(0)
    step = make_env(data.task, 3).reset(np.arange(3, dtype=np.uint64))
    policy.reset(step, np.arange(3))
    first, second = policy.act(step), policy.act(step)
    assert (first != second).any((1, 2)).all()
    policy.reset(step, np.array([1]))
    third = policy.act(step)
    np.testing.assert_array_equal(third[1], first[1])
    assert (third[[0, 2]] != first[[0, 2]]).any((1, 2)).all()


@KINDS
def test_copies_must_be_reset_first(train: Train, data: Dataset) -> None:
    policy = train(data).policy(0)
    step = make_env(data.task, 3).reset(np.arange(3, dtype=np.uint64))
    with pytest.raises(SchemaError, match="Call reset"):
        policy.act(step)
    policy.reset(step, np.arange(3))
    with pytest.raises(SchemaError, match="remembers \\(3, 4\\)"):
        policy.act(Step._make(field[:2] for field in step))


@KINDS
def test_other_observations_are_refused(train: Train, data: Dataset) -> None:
    policy = train(data).policy(0)
    step = make_env(data.task, 2).reset(np.arange(2, dtype=np.uint64))
    other = step._replace(observations=step.observations[..., :-1])
    policy.reset(other, np.arange(2))
    with pytest.raises(SchemaError, match="features of 4 agents"):
        policy.act(other)


def test_what_needs_a_function_of_the_present_refuses_it(data: Dataset, tmp_path: Path) -> None:
    policy = bc(data).policy(0)
    with pytest.raises(SchemaError, match="RecurrentPolicy has no `actions"):
        actions_of([policy], data)
    save_policy(tmp_path / "policy.safetensors", policy)
    with pytest.raises(BuildError, match="without a memory"):
        export(tmp_path / "policy.safetensors", tmp_path / "actor.safetensors", 4)


@pytest.mark.parametrize(
    ("in_frame", "settings"), [(True, {}), (False, {"noise": "own", "redraw": "episode"})]
)
def test_students_of_a_flow_act_step_by_step_as_trained(
    data: Dataset, frame: Frame, in_frame: bool, settings: dict[str, Any]
) -> None:
    used = frame if in_frame else None
    algorithm, observations = mac_flow(data, used, **settings), np.array(data[0].observations)
    sampler = framed(data, used).sampler(1, horizon=FLOW["window"], burn_in=8, seed=0)
    batch = sampler.gather(np.array([[8]])).to_torch()  # steps 0 to 11, of which 8 to 11 count
    policy = algorithm.policy(0)
    assert isinstance(policy, RecurrentFlowPolicy)
    steps = steps_of(observations[:12], make_env(data.task, 1).reset(np.zeros(1, "u8")))
    for _ in range(2):  # a reset makes every episode the first
        policy.reset(steps[0], np.arange(1))
        actions = np.concatenate([policy.act(step) for step in steps])[8:]
    noise = np.concatenate([policy.draw(step) for step in steps])[8:]
    assert (noise[0] == noise[1]).all() == ("redraw" in settings)
    actor = algorithm.copy.actor
    expected = actor(actor.see(batch).features, torch.from_numpy(noise[None]).float())
    wanted = expected[0].detach().numpy()
    if used is not None:
        wanted = used.to_world(observations[8:12], wanted).astype(np.float32)
        wanted /= np.maximum(np.linalg.norm(wanted, axis=-1, keepdims=True), 1)
    np.testing.assert_allclose(actions, wanted, atol=1e-5)
