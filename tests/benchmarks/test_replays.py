"""Replays step what a team did, and find worlds that differ from the recorded one."""

import numpy as np
import pytest

from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from tests.benchmarks.bench_worlds import record_teams, scanning
from tests.benchmarks.replays import HORIZONS, Recording, Replay, joint_actions, record
from tests.benchmarks.teams import members

SPEC = preset("coop_nav-easy")
N_COPIES = 3


@pytest.fixture(scope="module")
def recording() -> Recording:
    return record(SPEC, members("scripted", "coop_nav-easy", SPEC), N_COPIES)


def test_copies_start_again_when_they_have_ended(recording: Recording) -> None:
    assert recording.actions.shape == (HORIZONS * SPEC.horizon, N_COPIES, SPEC.n_agents, 2)
    seeds = np.concatenate([reset.seeds for reset in recording.resets.values()])
    assert len(seeds) > HORIZONS * N_COPIES, "scripted teams solve the task before the horizon"
    assert seeds.tolist() == list(range(N_COPIES, N_COPIES + len(seeds)))


def test_a_replay_counts_all_copies_and_the_time_of_resets(recording: Recording) -> None:
    replay = Replay(SPEC, recording)
    assert replay(0.2) > 100
    assert 0 < replay.reset_share < 1


def test_sensors_do_not_change_the_world(recording: Recording) -> None:
    assert Replay(scanning(SPEC), recording)(0.01) > 0


def test_another_world_is_found(recording: Recording) -> None:
    other = SPEC.with_updates(horizon=SPEC.horizon // 8)
    with pytest.raises(RuntimeError, match=r"after step .* have ended, expected"):
        Replay(other, recording)


def test_checkpoints_have_equal_shares() -> None:
    spec = preset("coop_nav")
    policies = members("expert", "coop_nav", spec)
    step = make_env(spec, 8).reset(np.zeros(8, dtype=np.uint64))
    mixed = joint_actions(policies, step)
    for copy, actions in enumerate(mixed):
        assert np.array_equal(actions, policies[copy % len(policies)].act(step)[copy])
    assert not np.array_equal(mixed[0], mixed[1])


def test_teams_without_checkpoints_are_left_out() -> None:
    assert list(record_teams("coop_nav-easy", SPEC, ("random", "expert"), 1)) == ["random"]
