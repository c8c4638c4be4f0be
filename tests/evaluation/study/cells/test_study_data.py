"""What is known of the data of a study."""

from pathlib import Path

import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.evaluation.study.cells.study_data import DatasetFacts
from swarmdata.registry.presets import preset
from swarmdata.rollouts.metrics import metrics_of_side
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.recipe import PolicySource
from tests.support.tiny import make_tiny


def test_successes_of_a_side_are_clean_as_they_are_evaluated(tmp_path: Path) -> None:
    spec = preset("tag").with_updates(horizon=40)
    evader = (PolicySource(label="evader", name="idle"),)
    team = (PolicySource(label="a", name="random", opponents=evader),)
    whole = Dataset.open(make_tiny(tmp_path / "tag-tiny-v0", spec=spec, policies=team))
    for side in ("pursuers", "evader"):
        evaluated = SideSpec(whole=spec, side=side, opponents="idle")
        expected = [metrics_of_side(each, evaluated)["clean_success"] for each in whole]
        found = DatasetFacts.of(whole.side(side)).figures.clean_success
        assert found == pytest.approx(sum(expected) / len(whole))
