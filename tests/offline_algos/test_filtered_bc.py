"""Filtered behavior cloning: which episodes are kept, that the run says so, and that it helps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarmdata.errors import SchemaError
from swarmdata.learn.training.run_folder import load_run, read_run
from swarmdata.learn.training.trainer import train_seeds
from swarmdata.offline_algos.bc import BC, BCConfig
from swarmdata.offline_algos.filtered_bc import FilteredBC, FilteredBCConfig
from tests.offline_algos.conftest import drive
from tests.support.memory_dataset import MemoryDataset


@pytest.mark.parametrize(
    ("n", "fraction", "floor", "n_kept"),
    [
        (30, 0.1, 1, 3), (31, 0.1, 1, 4), (5, 0.1, 1, 1), (4, 1.0, 1, 4),
        (30, 0.1, 3, 3), (30, 0.1, 8, 8), (30, 0.8, 8, 24), (7, 0.1, 8, 4), (1, 0.1, 8, 1),
    ],
)  # fmt: skip
def test_the_number_kept_by_hand(n: int, fraction: float, floor: int, n_kept: int) -> None:
    returns = np.random.default_rng(n).permutation(n).astype(np.float64)
    config = FilteredBCConfig(fraction=fraction, min_episodes=floor)
    assert config.least_return(returns) == n - n_kept


def test_there_must_be_episodes() -> None:
    with pytest.raises(SchemaError, match="no episodes"):
        FilteredBCConfig().least_return(np.zeros(0))


def test_the_run_says_what_was_kept_and_is_behavior_cloning_of_it(
    mixture: MemoryDataset, tmp_path: Path
) -> None:
    config = FilteredBCConfig(n_updates=20, hidden=(8,), fraction=0.25, min_episodes=10)
    (policy,) = train_seeds("filtered_bc", mixture, tmp_path / "a", seeds=[3], config=config)
    run = read_run(tmp_path / "a")
    returns = np.sort([episode.team_return for episode in mixture])
    assert run.n_episodes == 50
    assert run.min_return == returns[-50]
    assert run.config["fraction"] == 0.25

    assert run.min_return is not None
    kept = replace(mixture, episodes=mixture.filter(min_return=run.min_return).episodes)
    (same,) = train_seeds(
        "bc", kept, tmp_path / "b", seeds=[3], config=BCConfig(n_updates=20, hidden=(8,))
    )
    observations = mixture.transitions["observations"]
    expected = same.actions(observations)  # type: ignore[attr-defined]
    assert np.array_equal(policy.actions(observations), expected)  # type: ignore[attr-defined]
    assert read_run(tmp_path / "b").min_return is None
    (again,) = load_run(tmp_path / "a")
    assert np.array_equal(again.actions(observations), expected)  # type: ignore[attr-defined]


@pytest.mark.learns
def test_it_beats_behavior_cloning_on_a_mixture(mixture: MemoryDataset, tmp_path: Path) -> None:
    """The best quarter of the mixture drive at the goal; half of all move at random."""
    observations = mixture.transitions["observations"]
    wanted = drive(observations[..., 2:4])
    errors = {}
    for kind, config in (
        (BC, BCConfig(n_updates=1000, hidden=(32, 32))),
        (
            FilteredBC,
            FilteredBCConfig(n_updates=1000, hidden=(32, 32), fraction=0.25, min_episodes=1),
        ),
    ):
        name = "filtered_bc" if kind is FilteredBC else "bc"
        (policy,) = train_seeds(name, mixture, tmp_path / name, seeds=[0], config=config)
        acted = policy.actions(observations)  # type: ignore[attr-defined]
        errors[name] = float(np.sqrt(np.square(acted - wanted).mean()))
    assert errors["filtered_bc"] < 0.2
    assert errors["filtered_bc"] < 0.6 * errors["bc"]
