"""Entries of other libraries: policies in files of ONNX."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="policies need torch")
pytest.importorskip("onnx", reason="the extra 'onnx'")
pytest.importorskip("onnxruntime", reason="the extra 'onnx'")

from onnx import helper

from swarmdata.errors import SpecError
from swarmdata.evaluation.leaderboard.entry import submit
from swarmdata.evaluation.leaderboard.verify import verify
from tests.evaluation.leaderboard.conftest import change_metrics
from tests.learn.deployment.test_onnx_policy import write
from tests.support.onnx_files import with_last_nodes

DATASET, N_EPISODES = "coop_nav-random-mini", 4

ABOUT: dict[str, Any] = {
    "name": "theirs", "license": "MIT", "code": "https://example.org", "trials": 1,
    "tuning_episodes": 0,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.usefixtures("forked")
def test_it_is_verified_and_an_altered_one_is_rejected(tmp_path: Path) -> None:
    files = [write(tmp_path / f"{seed}.onnx", seed=seed) for seed in range(5)]
    entry = tmp_path / "entry"
    found = submit(files, entry, DATASET, n_episodes=N_EPISODES, progress=False, **ABOUT)
    assert (found.algorithm, found.files[4]) == ("theirs", "policy-4.onnx")
    assert verify(entry, n_episodes=N_EPISODES).is_verified
    noise = np.random.default_rng(0).normal(0, 0.01, N_EPISODES)
    change_metrics(entry, noise, "return", "path_length")  # a little, as another runtime would
    assert verify(entry, n_episodes=N_EPISODES).is_verified
    change_metrics(entry, 50.0, "return")
    (reason,) = verify(entry, n_episodes=N_EPISODES).reasons
    assert reason.startswith("its return is +50 off on average")


@pytest.mark.slow
@pytest.mark.usefixtures("forked")
def test_policies_that_act_at_random_are_rejected(tmp_path: Path) -> None:
    """Their noise is so small that the mean is as it says."""
    files = [write(tmp_path / f"{seed}.onnx", seed=seed) for seed in range(5)]
    noise = helper.make_node("RandomNormalLike", ["plain"], ["noise"], scale=0.01)
    for file in files:
        with_last_nodes(file, noise, helper.make_node("Add", ["plain", "noise"], ["action"]))
    entry = tmp_path / "entry"
    submit(files, entry, DATASET, n_episodes=N_EPISODES, progress=False, **ABOUT)
    (reason,) = verify(entry, n_episodes=N_EPISODES).reasons
    assert "they act at random" in reason


def test_five_policies_are_needed(tmp_path: Path) -> None:
    file = write(tmp_path / "0.onnx")
    with pytest.raises(SpecError, match="there are 4 policies"):
        submit([file] * 4, tmp_path / "entry", DATASET, progress=False, **ABOUT)
