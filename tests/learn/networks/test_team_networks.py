"""Networks of a team: shared or separate, the same in any stack, and in a policy's hands."""

from typing import Any

import numpy as np
import pytest
import torch

from swarmdata.learn.networks.perceptrons import MLPShape
from swarmdata.learn.networks.team_networks import Team, answer, from_rows, to_rows
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.perception.frames import Frame, in_world

SHAPE = MLPShape(5, (6,), 2)
FEATURES = torch.randn(2, 7, 3, 5, generator=torch.Generator().manual_seed(0))


def made(parameters: Any, seeds: tuple[int, ...] = (4, 9)) -> Team:
    return Team(SHAPE, 3, seeds, 0, parameters=parameters, device="cpu")


@pytest.mark.parametrize("parameters", ["shared", "separate"])
def test_rows_come_back_to_their_robots(parameters: Any) -> None:
    rows = to_rows(FEATURES, parameters)
    assert len(rows) == (2 if parameters == "shared" else 6)
    assert torch.equal(from_rows(rows[..., :5], FEATURES.shape, parameters), FEATURES)


def test_a_shared_network_tells_robots_apart_by_their_number_only() -> None:
    same = FEATURES[:, :, :1].expand(-1, -1, 3, -1)
    outputs = made("shared")(same)
    assert not torch.allclose(outputs[:, :, 0], outputs[:, :, 1])
    team = made("shared")
    team.network.layers[0].weight.data[:, 5:] = 0
    outputs = team(same)
    torch.testing.assert_close(outputs[:, :, 0], outputs[:, :, 1])


def test_separate_networks_have_nothing_in_common() -> None:
    team = made("separate")
    assert len(np.unique(team.network.flat.numpy(), axis=0)) == 6
    before = team(FEATURES)
    team.network.flat[4] += 1.0  # seed 1, robot 1
    changed = (team(FEATURES) != before).flatten(3).any(-1).any(1)
    assert changed.tolist() == [[False, False, False], [False, True, False]]


@pytest.mark.parametrize("parameters", ["shared", "separate"])
def test_a_seed_answers_the_same_in_any_stack_and_alone(parameters: Any) -> None:
    team = made(parameters)
    outputs = team(FEATURES)
    for index, seed in enumerate((4, 9)):
        alone = made(parameters, (seed,))
        torch.testing.assert_close(alone(FEATURES[index : index + 1])[0], outputs[index])
        exact = answer(team.extract(index), FEATURES[index].double(), parameters)
        torch.testing.assert_close(exact.float(), outputs[index])


def policy(parameters: Any, frame: Frame | None = None) -> TorchPolicy:
    size = 5 if frame is None else 7
    team = Team(MLPShape(size, (6,), 2), 3, [1], 0, parameters=parameters, device="cpu")
    return TorchPolicy(
        layers=team.extract(0),
        observation_mean=torch.zeros(size, dtype=torch.float64),
        observation_std=torch.full((size,), 2.0, dtype=torch.float64),
        squash=True,
        frame=frame,
        parameters=parameters,
    )


def test_a_policy_of_a_frame_sees_and_acts_in_it() -> None:
    frame = Frame(anchor=0, vectors=(0, 3), closing=())
    ours = policy("shared", frame)
    observations = FEATURES[0].numpy()
    local = answer(ours.layers, torch.from_numpy(frame.inputs(observations)).double() / 2, "shared")
    expected = frame.to_world(observations, local.tanh().numpy())
    norms = np.maximum(np.linalg.norm(expected, axis=-1, keepdims=True), 1)
    np.testing.assert_allclose(ours.actions(observations), expected / norms, atol=1e-6)


def test_turned_actions_keep_their_direction_and_stay_in_the_box() -> None:
    """A corner of the box has norm 1.4; the worlds clip norms, so the policy does, not axes."""
    frame = Frame(anchor=0, vectors=(0,), closing=())
    observations = np.array([[[0.6, 0.8]]], np.float32)
    action = in_world(frame, observations, np.array([[[1.0, 1.0]]]))
    np.testing.assert_allclose(action[0, 0], frame.to_world(
        observations, np.array([[[1.0, 1.0]]])
    )[0, 0] / 2**0.5, atol=1e-6)  # fmt: skip
    assert np.abs(action).max() <= 1
    straight = in_world(None, observations, np.array([[[1.0, 1.0]]]))
    assert straight.tolist() == [[[1.0, 1.0]]]
