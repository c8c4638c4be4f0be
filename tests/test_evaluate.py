"""Evaluation is the same however it is run, and its file gives back the same bits."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata import __version__
from swarmdata.density import noisy_log_probs
from swarmdata.errors import FormatVersionError, SchemaError
from swarmdata.evaluate import check_comparable, evaluate, load, load_metadata, save
from swarmdata.metrics import metrics_of
from swarmdata.seeding import EVALUATION_BASE, evaluation_seeds
from swarmdata.spec import TaskSpec
from swarmdata.types import EvalResult, Float, Int, Step

METRICS = metrics_of("coop_nav")

SPEC = TaskSpec(horizon=30)


class Seek:
    """Drives straight at the goal."""

    uses_state = False

    def reset(self, step: Step, copies: Int) -> None:
        pass

    def act(self, step: Step) -> Float:
        return np.clip(step.observations[..., 6:8], -1.0, 1.0)

    def log_probs(self, step: Step, actions: Float) -> Float:
        return noisy_log_probs(self.act(step).astype(np.float64), actions, 0.0)


def result(policy: str = "seek", n: int = 5, **changes: Any) -> EvalResult:
    rng = np.random.default_rng(len(policy))
    metrics = {name: rng.normal(size=n) for name in METRICS}
    metrics["time_to_goal"][::2] = np.nan
    made = EvalResult(policy, "coop_nav", "f" * 64, evaluation_seeds(n), metrics)
    return replace(made, **changes)


def test_evaluation_does_not_depend_on_the_number_of_copies() -> None:
    few = evaluate(Seek(), SPEC, name="seek", n_episodes=9, n_copies=2, progress=False)
    many = evaluate(Seek(), SPEC, name="seek", n_episodes=9, n_copies=64, progress=False)
    assert few.policy == "seek"
    assert (few.task, few.spec_hash) == ("coop_nav", SPEC.hash())
    assert few.seeds.tolist() == [EVALUATION_BASE + k for k in range(9)]
    assert list(few.metrics) == list(METRICS)
    for name in METRICS:
        np.testing.assert_array_equal(few.metrics[name], many.metrics[name])
    assert (few.metrics["path_length"] > 0.3).all()
    assert (few.metrics["length"] == 30).any()


def test_no_episodes_are_refused() -> None:
    with pytest.raises(SchemaError, match="n_episodes is 0, expected at least 1"):
        evaluate(Seek(), SPEC, name="seek", n_episodes=0)


def test_saved_and_loaded_bits_are_equal(tmp_path: Path) -> None:
    path = tmp_path / "seek.json"
    original = result()
    original.metrics["return"][:2] = [0.1 + 0.2, 5e-324]
    save(original, path, metadata={"dataset_digest": "ab", "config": {"discount": 0.95}, "seed": 3})
    loaded = load(path)
    assert (loaded.policy, loaded.task) == (original.policy, original.task)
    assert loaded.spec_hash == original.spec_hash
    assert loaded.seeds.dtype == np.uint64
    np.testing.assert_array_equal(loaded.seeds, original.seeds)
    for name in METRICS:
        same = original.metrics[name].view(np.uint64)
        np.testing.assert_array_equal(
            np.isnan(loaded.metrics[name]), np.isnan(original.metrics[name])
        )
        finite = ~np.isnan(original.metrics[name])
        np.testing.assert_array_equal(loaded.metrics[name].view(np.uint64)[finite], same[finite])
    assert load_metadata(path) == {
        "dataset_digest": "ab",
        "config": {"discount": 0.95},
        "seed": 3,
        "code_version": __version__,
    }


def test_the_file_is_strict_json_with_null_for_undefined(tmp_path: Path) -> None:
    path = tmp_path / "seek.json"
    save(result(), path)

    def refuse(token: str) -> None:
        raise AssertionError(token)

    data = json.loads(path.read_text(), parse_constant=refuse)
    assert data["metrics"]["time_to_goal"][0] is None


def test_what_json_cannot_hold_is_refused_and_the_old_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "seek.json"
    save(result(), path)
    before = path.read_bytes()
    broken = result()
    broken.metrics["return"][0] = math.inf
    with pytest.raises(SchemaError, match="'seek' cannot be written as JSON"):
        save(broken, path)
    with pytest.raises(SchemaError, match="plain finite JSON values"):
        save(result(), path, metadata={"path": tmp_path})
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["seek.json"]


def test_a_failed_write_leaves_the_old_file_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "seek.json"
    save(result(), path)
    before = path.read_bytes()

    def full_disk(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full_disk)
    with pytest.raises(OSError, match="No space left"):
        save(result("other"), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["seek.json"]


def edited(path: Path, **changes: Any) -> Path:
    save(result(), path)
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))
    return path


def test_unreadable_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    with pytest.raises(FileNotFoundError):
        load(path)
    path.write_text('{"half": ')
    with pytest.raises(SchemaError, match="is not JSON"):
        load(path)
    path.write_text("[]")
    with pytest.raises(SchemaError, match="is not an evaluation result"):
        load(path)
    with pytest.raises(SchemaError, match=r"note: unknown key"):
        load(edited(path, note="hello"))
    with pytest.raises(SchemaError, match=r"missing .*'return'"):
        load(edited(path, metrics={}))
    with pytest.raises(SchemaError, match="has 0 seeds but"):
        load(edited(path, seeds=[]))
    with pytest.raises(
        FormatVersionError, match="evaluation format 2, this swarmdata reads up to 1"
    ):
        load(edited(path, format_version=2))


def test_only_results_of_one_spec_and_the_same_seeds_compare() -> None:
    check_comparable([result(), result("other")])
    with pytest.raises(SchemaError, match="'seek' and 'old' are of different specs"):
        check_comparable([result(), result("old", spec_hash="0" * 64)])
    with pytest.raises(SchemaError, match=r"different seeds \(5 and 4 episodes\)"):
        check_comparable([result(), result("short", n=4)])
    with pytest.raises(SchemaError, match="no results to compare"):
        check_comparable([])
