"""The example trains, and what it writes is read as results beside ours."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

import swarmdata
from swarmdata.evaluate import evaluate
from swarmdata.provenance import Provenance
from swarmdata.registry import make_policy
from swarmdata.result_files import Result, save
from swarmdata.results import read
from tests.examples import own_algorithm as example
from tests.tiny import make_tiny


def test_a_short_run_is_reported_beside_ours(tmp_path: Path) -> None:
    dataset = swarmdata.Dataset.open(make_tiny(tmp_path / "coop_nav-tiny-v0"))
    out = tmp_path / "results"
    files = example.main(str(dataset.path), out, n_seeds=2, n_updates=3, n_episodes=2)
    ours = evaluate(
        make_policy("idle", dataset.task), dataset.task, name="idle", n_episodes=2, progress=False
    )
    about = {"dataset": dataset.id, "digest": dataset.digest, "algorithm": "bc"}
    save(Result(ours, Provenance(label="idle", **about), dataset.task), out)
    (case,) = read([out], data=[dataset.path]).cases
    assert set(case.runs) == {"mine", "idle"}
    assert [result.path for result in case.runs["mine"]] == files
    assert case.metric("mine", "return").shape == (2, 2)


def test_a_seed_decides_the_policy(tmp_path: Path) -> None:
    dataset = swarmdata.Dataset.open(make_tiny(tmp_path / "coop_nav-tiny-v0"))
    step = dataset.make_env(2).reset(np.arange(2, dtype=np.uint64))
    actions = [example.train(dataset, seed, 3).act(step) for seed in (0, 0, 1)]
    assert np.array_equal(actions[0], actions[1])
    assert not np.array_equal(actions[0], actions[2])


def test_it_is_forty_lines() -> None:
    """The training loop, from its definition to the policy that it returns."""
    lines = Path(example.__file__).read_text(encoding="utf-8").splitlines()
    start = lines.index("def train(")
    end = lines.index("    return swarmdata.FunctionPolicy(act)")
    assert end - start + 1 <= 40
