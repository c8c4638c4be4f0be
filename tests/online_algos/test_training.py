"""Online runs: an interrupted run ends as a whole one, and shipping picks the right actors."""

import csv
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch", reason="online algorithms need the torch extra")

from swarmdata.errors import BuildError
from swarmdata.online_algos import training
from swarmdata.online_algos.mappo import Config
from swarmdata.online_algos.training import find_medium, read_curve, ship, train_run
from swarmdata.spec import TaskSpec

SPEC = TaskSpec(horizon=20)
SMALL = Config(n_frames=3000, n_copies=4, n_steps=8, hidden=8, minibatch=64)


def finish(out: Path) -> Path:
    return train_run(SPEC, SMALL, 0, out, n_episodes=2)


def test_an_interrupted_run_ends_as_an_uninterrupted_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = finish(tmp_path / "whole")
    measure, calls = training.measure, []

    def interrupt(*args: Any) -> dict[str, float]:
        calls.append(args)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return measure(*args)

    monkeypatch.setattr(training, "measure", interrupt)
    with pytest.raises(KeyboardInterrupt):
        finish(tmp_path / "cut")
    finish(tmp_path / "cut")
    for name in ("curve.csv", "config.json", "state.safetensors"):
        assert (whole / name).read_bytes() == (tmp_path / "cut" / name).read_bytes(), name
    last = max(path.name for path in (whole / "actors").iterdir())
    assert (whole / "actors" / last).read_bytes() == (tmp_path / "cut/actors" / last).read_bytes()


def test_another_configuration_does_not_continue_a_run(tmp_path: Path) -> None:
    finish(tmp_path / "run")
    with pytest.raises(BuildError, match="another configuration"):
        train_run(SPEC, SMALL, 1, tmp_path / "run", n_episodes=2)


def test_the_medium_is_the_first_checkpoint_in_the_band(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = finish(tmp_path / "run")
    rows = read_curve(run)
    success = dict(zip([row["frames"] for row in rows], [0.1, 0.45, 0.5], strict=False))
    with (run / "curve.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({**row, "success": success.get(row["frames"], 0.9)} for row in rows)
    figures = {"success": 0.55}
    monkeypatch.setattr(training, "measure", lambda *_: figures)
    assert find_medium(run, SPEC) == (
        run / "actors" / f"{int(rows[1]['frames']):010d}.safetensors",
        figures,
    )
    monkeypatch.setattr(training, "measure", lambda *_: {"success": 0.7})
    with pytest.raises(BuildError, match="no checkpoint"):
        find_medium(run, SPEC)


def test_shipping_writes_actors_curves_and_the_index(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = finish(tmp_path / "run")
    source = next((run / "actors").iterdir())
    monkeypatch.setattr(training, "find_medium", lambda *_: (source, {"success": 0.5}))
    entry = ship([run], [run], SPEC, tmp_path / "shipped")
    names = {path.name for path in (tmp_path / "shipped").iterdir()}
    tiers = {"coop_nav-medium-0", "coop_nav-expert-0"}
    assert names == {"index.json"} | {
        f"{t}.{kind}" for t in tiers for kind in ("safetensors", "csv")
    }
    assert entry["expert"][0]["frames"] >= SMALL.n_frames
    assert 0 <= entry["expert"][0]["figures"]["exact_error"] < 0.02


def test_an_unfinished_run_is_no_expert(tmp_path: Path) -> None:
    run = finish(tmp_path / "run")
    max((run / "actors").iterdir()).unlink()
    with pytest.raises(BuildError, match="run its command again"):
        training.last_actor(run, SPEC)
