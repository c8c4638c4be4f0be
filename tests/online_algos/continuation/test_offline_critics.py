"""Critics that online training takes over: equal values, their units, and what begins anew."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import pytest

torch = pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.datasets.dataset import Dataset  # noqa: E402
from swarmdata.learn.networks.critics import RobotCritics  # noqa: E402
from swarmdata.learn.training.compact import compact  # noqa: E402
from swarmdata.learn.training.overrides import override  # noqa: E402
from swarmdata.learn.training.trainer import train_seeds  # noqa: E402
from swarmdata.online_algos.continuation.offline_start import read_start  # noqa: E402
from swarmdata.online_algos.maddpg import MADDPG, MADDPGConfig  # noqa: E402
from swarmdata.perception.observer import features_of  # noqa: E402
from swarmdata.registry.components import (  # noqa: E402
    OFFLINE_ALGORITHMS,
    make_env,
    make_task,
    resolve,
)
from swarmdata.rollouts.task_frame import frame_of  # noqa: E402
from tests.support.one_process import use_one_process  # noqa: E402
from tests.support.tiny import TINY, make_tiny  # noqa: E402

SEEDS = (0, 1)
SMALL = {
    "n_steps": "160", "n_copies": "4", "rollout_steps": "8", "batch_size": "8", "capacity": "200",
    "margin": "200", "warmup_transitions": "16",
}  # fmt: skip

Offline = Callable[..., Path]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dataset]:
    with pytest.MonkeyPatch.context() as patch:
        use_one_process(patch)
        yield Dataset.open(make_tiny(tmp_path_factory.mktemp("data") / TINY.id))


@pytest.fixture
def offline(dataset: Dataset, tmp_path: Path) -> Offline:
    """Trains an offline run of a few updates."""

    def train(algorithm: str, rewards: Mapping[str, float] | None = None, **changes: str) -> Path:
        kind = resolve("algorithm", OFFLINE_ALGORITHMS, algorithm)
        small = {"n_updates": "6", "batch_size": "16"}
        if algorithm != "bc":
            small |= {"critic_hidden": "8", "actor_hidden": "12"}
        train_seeds(
            algorithm, dataset.with_rewards(**rewards or {}), tmp_path / algorithm, seeds=SEEDS,
            config=override(kind.Config(), {**small, **changes}), frame=frame_of(dataset.spec),
            progress=False,
        )  # fmt: skip
        return tmp_path / algorithm

    return train


def started(run: Path, folder: Path, **changes: str) -> tuple[MADDPG, list[str]]:
    """Online training that began with a run, its seeds in another order; and what it said."""
    begin = read_start(run)
    settings = MADDPG.settings_of(begin, features_of(make_task(TINY.spec)))
    config = override(MADDPGConfig(), {**settings, **SMALL, **changes})
    assert isinstance(config, MADDPGConfig)
    online = MADDPG(make_env(TINY.spec, 2 * config.n_copies), SEEDS[::-1], config, folder)
    return online, online.start_from(begin)


@pytest.mark.parametrize(
    ("algorithm", "changes"),
    [("maddpg_bc", {"critic": "decentralized"}), ("cfcql", {}), ("iql", {})],
)
def test_robots_have_the_values_of_the_offline_run(
    algorithm: str, changes: dict[str, str], offline: Offline, tmp_path: Path
) -> None:
    """Also those of the slow copies; the statistics that critics see by are those of the run."""
    run = offline(algorithm, **changes)
    begin = read_start(run)
    theirs = cast("RobotCritics", cast("Any", begin.algorithm).critics)
    assert not torch.equal(theirs.online.flat, theirs.target.flat)
    online, sentences = started(run, tmp_path / "replay")
    assert sentences == []
    online.update()
    batch = online.collector._draw()
    online, _ = started(run, tmp_path / "again")
    mine = online.learner.critics
    ours, others = mine.view(batch.states, batch.observations), batch.actions
    seen = theirs.view(batch.states.flip(0), batch.observations.flip(0))
    assert torch.equal(mine.q(ours, others), theirs.q(seen, others.flip(0)).flip(0))
    assert torch.equal(mine.target_q(ours, others), theirs.target_q(seen, others.flip(0)).flip(0))


def test_values_stay_in_the_units_of_the_offline_run(offline: Offline, tmp_path: Path) -> None:
    run = offline("maddpg_bc", discount="0.9")
    online, _ = started(run, tmp_path / "replay")
    config, scale = online.config, 1 / read_start(run).statistics.own_return_std
    assert (config.discount, config.reward_scale) == (0.9, scale)
    assert (config.critic, config.critic_hidden) == ("centralized", (8,))


ANEW = [
    ("bc", {}, {}, "bc has none of each robot"),
    ("omar", {}, {}, "omar has none of each robot"),
    ("maddpg_bc", {"reward": "team"}, {}, "they value the team's reward"),
    ("maddpg_bc", {}, {"critic": "decentralized"}, "Leave out the settings of the critics"),
    ("maddpg_bc", {}, {"critic_hidden": "9"}, "Leave out the settings of the critics"),
    ("maddpg_bc", {}, {"corrections": "none"}, "Leave out the settings of the critics"),
]


@pytest.mark.parametrize(("algorithm", "changes", "online_changes", "reason"), ANEW)
def test_critics_of_other_kinds_begin_anew_and_it_says_why(
    algorithm: str, changes: dict[str, str], online_changes: dict[str, str], reason: str,
    offline: Offline, tmp_path: Path,
) -> None:  # fmt: skip
    online, (sentence,) = started(
        offline(algorithm, **changes), tmp_path / "replay", **online_changes
    )
    assert sentence.startswith("The critics begin anew, not with those of ")
    assert reason in sentence
    online.update()


def test_critics_of_other_rewards_begin_anew(offline: Offline, tmp_path: Path) -> None:
    run = offline("maddpg_bc", rewards={"robot_collision": 9.0})
    (sentence,) = started(run, tmp_path)[1]
    assert sentence.endswith("they value other weights of rewards than the task's.")


def test_a_run_that_was_made_small_has_no_critics(offline: Offline, tmp_path: Path) -> None:
    run = offline("maddpg_bc")
    compact(run)
    _, (sentence,) = started(run, tmp_path / "replay")
    assert "its checkpoint was made small" in sentence
