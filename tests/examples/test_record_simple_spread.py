"""The example runs, and what it learns is better than chance."""

from pathlib import Path

import numpy as np
import pytest

from swarmdata.specs.origins import RecordedSpec
from tests.examples import record_simple_spread as example

pytest.importorskip("mpe2")
pytest.importorskip("torch")


def test_a_short_run(tmp_path: Path) -> None:
    dataset = example.record(tmp_path / example.ID, n_episodes=10)
    assert isinstance(dataset.spec, RecordedSpec)
    assert dataset.filter(policy="hasty").n_episodes == 5
    assert "| author | swarmdata's examples |" in dataset.card
    policies = example.train(dataset.path, tmp_path / "run", n_updates=10)
    assert np.isfinite(example.play(policies, dataset.spec, n_episodes=1)).all()


@pytest.mark.learns
def test_what_is_learned_beats_random_actions(tmp_path: Path) -> None:
    found = example.main(tmp_path)
    assert found["recorded: careful"] > found["random actions"] + 5
    for seed in (0, 1):
        assert found[f"learned: seed {seed}"] > found["random actions"] + 5
