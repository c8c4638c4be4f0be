"""Peers see what our algorithms see, act where ours act, and leave nothing behind."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

import torch
from torch import nn

from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.network_inputs import Normalizer
from swarmdata.learn.training.framed_dataset import framed
from swarmdata.registry.components import make_env
from tests.benchmarks.bench_algorithms import PEERS, REPOSITORIES, play
from tests.benchmarks.peers.checkouts import import_from, read_module
from tests.benchmarks.peers.corl import of_width
from tests.benchmarks.peers.og_marl_cql import RecurrentPolicy
from tests.benchmarks.peers.omar import data_type
from tests.benchmarks.peers.team_data import DISCOUNT, Budget, TeamData


@pytest.fixture(scope="module")
def data(tiny: Path) -> TeamData:
    return TeamData(str(tiny))


def test_peers_get_the_rows_that_our_trainer_draws(data: TeamData) -> None:
    ours = framed(data.train, data.frame)
    known = Normalizer(Statistics.measure(ours, DISCOUNT), "cpu")
    rng = np.random.default_rng(0)
    theirs = data.draw(rng, 16)
    valid = data.train.sampler(1, seed=0).rows.valid
    index = valid[np.random.default_rng(0).integers(len(valid), size=16)]
    batch = ours.sampler(16, seed=0).gather(index).to_torch()
    torch.testing.assert_close(theirs.observations, known.observations(batch.observations))
    torch.testing.assert_close(theirs.actions, batch.actions)
    torch.testing.assert_close(theirs.rewards, batch.rewards * known.reward_scale)


def test_windows_are_consecutive_steps_of_the_train_split(data: TeamData) -> None:
    windows = data.windows(np.random.default_rng(0), 64, 5)
    ends = windows.terminations | windows.truncations
    goes_on = ~ends[:, :-1]
    assert goes_on.any()
    assert ends[:, :-1].any(), "windows cross the ends of episodes, as one long stream does"
    torch.testing.assert_close(
        windows.next_observations[:, :-1][goes_on], windows.observations[:, 1:][goes_on]
    )


def test_policies_act_in_the_frame_that_they_learned_in(data: TeamData) -> None:
    assert data.frame is not None
    step = make_env(data.spec, 3).reset(np.arange(3, dtype=np.uint64))
    ahead = torch.tensor([0.5, 0.0], dtype=torch.float64).expand(3, data.n_agents, 2)
    acted = data.policy(lambda _: ahead).act(step)
    ux, uy = data.frame.directions(step.observations)
    np.testing.assert_allclose(acted, 0.5 * np.stack([ux, uy], -1), atol=1e-6)
    assert np.ptp(acted[..., 0]) > 0.1, "robots look in different directions"


def test_their_inputs_are_those_of_the_batches(data: TeamData) -> None:
    row = int(data.train.sampler(1, seed=0).rows.valid[0])
    raw = data.train.sampler(1, seed=0).gather(np.array([row]))
    seen = data.inputs(raw.observations)
    torch.testing.assert_close(seen.float(), data._gather(np.array([row])).observations)


def test_a_recurrent_policy_forgets_only_the_copies_that_begin_again(data: TeamData) -> None:
    class Counter(nn.Module):
        recurrent_layer_dim = 1

        def forward(self, inputs: torch.Tensor, hidden: torch.Tensor) -> object:
            assert inputs.shape[1] == data.n_observations
            hidden = hidden + 0.125
            return hidden[0].expand(-1, data.n_actions), hidden

    policy = RecurrentPolicy(data, Counter(), lambda inputs: inputs)
    step = make_env(data.spec, 3).reset(np.arange(3, dtype=np.uint64))
    policy.reset(step, np.arange(3))
    norms = [np.linalg.norm(policy.act(step), axis=-1)[:, 0] for _ in range(2)]
    policy.reset(step, np.array([1]))
    norms.append(np.linalg.norm(policy.act(step), axis=-1)[:, 0])
    expected = np.array([[1, 1, 1], [2, 2, 2], [3, 1, 3]]) * np.sqrt(2) / 8
    np.testing.assert_allclose(norms, expected, atol=1e-6)


def test_layers_are_made_again_with_other_units() -> None:
    network = nn.Sequential(nn.Linear(5, 256), nn.ReLU(), nn.Linear(256, 256), nn.Linear(256, 2))
    shapes = [tuple(p.shape) for p in of_width(network, 7).parameters() if p.ndim == 2]
    assert shapes == [(7, 5), (7, 7), (2, 7)]


def test_files_run_without_what_they_import_for_other_things(tmp_path: Path) -> None:
    source = "import absent_simulator as a\n\n@a.wrap()\ndef train(): ...\n\nVALUE = 3\n"
    (tmp_path / "peer.py").write_text(source)
    before = set(sys.modules)
    assert read_module(tmp_path / "peer.py", "absent_simulator").VALUE == 3
    assert set(sys.modules) == before
    with pytest.raises(ModuleNotFoundError, match="absent_simulator"):
        read_module(tmp_path / "peer.py")
    with pytest.raises(FileNotFoundError, match=r"expected a file of the checkout"):
        read_module(tmp_path / "other.py")


def test_packages_of_different_checkouts_do_not_mix(tmp_path: Path) -> None:
    for name in ("one", "two"):
        folder = tmp_path / name / "parts" / "deep" / "deeper"  # without __init__.py, as some are
        folder.mkdir(parents=True)
        (folder / "inner.py").write_text(f"NAME = {name!r}\n")
        (folder / "outer.py").write_text("from parts.deep.deeper.inner import NAME\n")
    before, path = set(sys.modules), list(sys.path)
    for name in ("one", "two", "one"):
        assert name == import_from(tmp_path / name, "parts.deep.deeper.outer").NAME
    assert (set(sys.modules), sys.path) == (before, path)


def test_the_kind_of_a_dataset_is_the_end_of_its_id() -> None:
    assert data_type("coop_nav-medium-replay-mini-v1") == "medium-replay"
    assert data_type("coop_nav-medium") == "medium"
    with pytest.raises(ValueError, match="got 'coop_nav-narrow', expected an id that ends in"):
        data_type("coop_nav-narrow")


@pytest.mark.slow
@pytest.mark.parametrize("name", PEERS)
def test_a_peer_trains_and_plays(
    name: str, data: TeamData, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = PEERS[name].repository
    checkout = os.environ.get(key.upper())
    if not checkout:
        pytest.skip(f"{key.upper()} names no checkout of {REPOSITORIES[key]}")
    monkeypatch.setattr(data, "id", "coop_nav-medium-mini")  # OMAR asks for the kind
    budget = Budget(n_updates=3, batch_size=8, units=8, n_seeds=1, n_episodes=2)
    policy = PEERS[name].train(Path(checkout), data, budget, 0)
    again = PEERS[name].train(Path(checkout), data, budget, 0)
    first, second = (play(data, each, name, budget)["return"] for each in (policy, again))
    np.testing.assert_array_equal(first, second)
