"""Networks of a team: shared or separate, and the same in any stack."""

from typing import Any

import numpy as np
import pytest
import torch

from swarmdata.learn.networks.perceptrons import MLPShape
from swarmdata.learn.networks.team_networks import Team, from_rows, to_rows

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
