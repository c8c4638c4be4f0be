"""BenchMARL's MAPPO trains in a world of this library, and is scored like every other policy."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("benchmarl", reason="BenchMARL 1.5 with TorchRL 0.11, which has its own venv")
pytestmark = pytest.mark.filterwarnings("default")  # BenchMARL, TorchRL and Hydra have their own


@pytest.mark.slow
def test_two_iterations_are_trained_and_scored(tmp_path: Path) -> None:
    from tests.examples import benchmarl_mappo as example

    experiment = example.train(tmp_path / "run", n_iterations=2)
    assert experiment.total_frames == 2 * 100 * example.COPIES
    assert set(experiment.observation_spec.keys(True, True)) == {(example.GROUP, "observation")}
    result = example.score(experiment, "coop_nav", n_episodes=4)
    assert np.isfinite(result.metrics["return"]).all()
