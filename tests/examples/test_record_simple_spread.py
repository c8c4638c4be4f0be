"""The example runs, and the learned policies are better than random actions."""

from pathlib import Path

import numpy as np
import pytest

import swarmdata
from tests.examples import record_simple_spread as example

pytestmark = pytest.mark.slow

pytest.importorskip("mpe2")
pytest.importorskip("torch")


def test_a_short_run(tmp_path: Path) -> None:
    dataset = example.record(tmp_path / example.ID, n_episodes=10)
    assert isinstance(dataset.spec, swarmdata.RecordedSpec)
    assert dataset.filter(policy="hasty").n_episodes == 5
    assert "| author | swarmdata's examples |" in dataset.card
    policies = example.train(dataset.path, tmp_path / "run", n_updates=10)
    assert np.isfinite(example.play(policies, dataset.spec, n_episodes=1)).all()


@pytest.mark.learns
def test_what_is_learned_beats_random_actions(tmp_path: Path) -> None:
    returns = example.main(tmp_path)
    assert returns["recorded: careful"] > returns["random actions"] + 5
    for seed in (0, 1):
        assert returns[f"learned: seed {seed}"] > returns["random actions"] + 5
