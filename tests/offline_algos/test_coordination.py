"""What data with two conventions are for: imitating each robot fails, agreeing on one succeeds."""

from pathlib import Path

import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.evaluation.runs.train import train
from swarmdata.hub.catalog.catalog import load
from swarmdata.registry.published import references
from swarmdata.registry.recipes import FAMILY_SPECS
from swarmdata.registry.tiers import CONVENTION_FAMILIES
from swarmdata.rollouts.evaluate import evaluate

pytestmark = pytest.mark.learns

SMALL = {"n_updates": "1500", "batch_size": "128", "hidden": "64,64"}


def score(algorithm: str, dataset: Dataset, family: str, folder: Path) -> float:
    """The mean score of three small policies on validation seeds."""
    policies = train(algorithm, dataset.id, folder / algorithm, changes=SMALL, curve_every=10**9)
    returns = [
        evaluate(policy, FAMILY_SPECS[family], name=algorithm, n_episodes=64, block="validation")
        .metrics["return"]
        .mean()
        for policy in policies
    ]
    found = references()[family].score(sum(returns) / len(returns))
    assert found is not None
    return found


@pytest.mark.parametrize("family", CONVENTION_FAMILIES)
def test_clones_of_both_conventions_fail_and_clones_of_the_best_episodes_succeed(
    family: str, tmp_path: Path
) -> None:
    dataset = load(f"{family}-two-conventions-mini", progress=False)
    mean = references()[family].score(float(dataset.episodes.team_return.mean()))
    assert mean is not None
    assert mean >= 95
    assert score("bc", dataset, family, tmp_path) <= 60
    assert score("filtered_bc", dataset, family, tmp_path) >= 90
