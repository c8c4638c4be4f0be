"""The digest of a run changes with what its policies are, and needs no torch."""

from pathlib import Path

import pytest

from swarmdata.errors import BuildError
from swarmdata.learn.training.run_files import (
    Seed,
    last_policy_path,
    measured_files,
    run_folders,
    run_hash,
    seeds_of,
)


def make_run(folder: Path, **files: str) -> Path:
    for name, text in {"config.json": "{}", **files}.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def test_every_measured_file_counts_and_no_other(tmp_path: Path) -> None:
    offline = {"config.json": '{"dataset": "x"}', "checkpoint.safetensors": "a", "curve.csv": "1"}
    run = make_run(tmp_path / "bc", **offline)
    before = run_hash(run, 0)
    (run / "curve.csv").write_text("2")
    assert run_hash(run, 0) == before
    (run / "checkpoint.safetensors").write_text("b")
    changed = run_hash(run, 0)
    assert changed != before
    (run / "config.json").write_text('{"dataset": "y"}')
    assert run_hash(run, 0) not in {before, changed}
    (run / "checkpoint.safetensors").unlink()
    assert len({before, changed, run_hash(run, 0)}) == 3


def test_an_online_seed_is_its_newest_policy(tmp_path: Path) -> None:
    name = "policies/seed-1/{:010d}.safetensors".format
    run = make_run(tmp_path / "run", **{name(5): "a", name(20): "b"})
    assert measured_files(run, 1)[-1] == run / name(20)
    before, other = run_hash(run, 1), run_hash(run, 0)
    assert before != other
    make_run(run, **{name(100): "b"})
    assert run_hash(run, 1) != before
    assert run_hash(run, 0) == other


def test_a_folder_is_a_run_or_holds_those_of_processes(tmp_path: Path) -> None:
    assert run_folders(tmp_path) == ()
    parts = tuple(make_run(tmp_path / f"seeds-{k}") for k in (0, 1))
    assert run_folders(tmp_path) == parts
    assert run_folders(parts[1]) == (parts[1],)


def test_seeds_are_those_of_a_run_or_of_all_processes(tmp_path: Path) -> None:
    first = make_run(tmp_path / "seeds-0-1", **{"config.json": '{"seeds": [0, 1]}'})
    second = make_run(tmp_path / "seeds-10", **{"config.json": '{"seeds": [10]}'})
    assert seeds_of([first]) == [Seed(first, 0), Seed(first, 1)]
    assert seeds_of([tmp_path]) == [Seed(first, 0), Seed(first, 1), Seed(second, 10)]
    with pytest.raises(BuildError, match="holds no run"):
        seeds_of([tmp_path / "nothing"])
    with pytest.raises(BuildError, match="wait for its first checkpoint"):
        last_policy_path(first, 0)
