"""The figure of online learning: files become lines, lines become a picture."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.curve_plots import draw_training, plot_learning
from swarmdata.evaluation.results.learning_curves import (
    Curve,
    curve_files,
    group_files,
    interval_of,
)
from swarmdata.rollouts.score_intervals import SHARE


def paths(*names: str) -> list[Path]:
    return [Path(name) for name in names]


def test_files_are_grouped_by_their_names() -> None:
    files = paths("runs/mappo/coop_nav.csv", "runs/vdn/coop_nav.csv", "runs/mappo/formation.csv")
    found = group_files(files, "algorithm/task")
    assert list(found) == ["coop_nav", "formation"]
    assert found["coop_nav"] == {"mappo": [files[0]], "vdn": [files[1]]}
    several = paths("a/coop_nav-n8-qmix/0/curve.csv", "a/coop_nav-n8-qmix/1/curve.csv")
    assert group_files(several, "task-algorithm/*/*") == {"coop_nav-n8": {"qmix": several}}
    assert group_files(paths("mappo/coop_nav.csv"), "algorithm/task")["coop_nav"]["mappo"]


@pytest.mark.parametrize("pattern", ["algorithm", "task/*", "algorithm/task/task", ""])
def test_patterns_name_both_once(pattern: str) -> None:
    with pytest.raises(SchemaError, match="'algorithm' and 'task' once each"):
        group_files(paths("mappo/coop_nav.csv"), pattern)


def test_files_that_do_not_fit_are_named() -> None:
    with pytest.raises(
        SchemaError, match=r"coop_nav.csv does not match the pattern 'algorithm-task'"
    ):
        group_files(paths("mappo/coop_nav.csv"), "algorithm-task")


def write_run(folder: Path) -> Path:
    """What curves need of a run whose seeds two processes trained."""
    for seed in (0, 1):
        inside = folder / f"seeds-{seed}"
        inside.mkdir(parents=True)
        (inside / "config.json").write_text("{}")
        rows = "".join(f"{100 * k},{seed},{0.1 * k},{k}\n" for k in range(1, 4))
        (inside / "curve.csv").write_text("frames,seed,success,return\n" + rows)
    return folder


def test_a_run_folder_stands_for_its_curves(tmp_path: Path) -> None:
    run = write_run(tmp_path / "mappo-v1.5" / "coop_nav")
    files = [run / "seeds-0" / "curve.csv", run / "seeds-1" / "curve.csv"]
    assert curve_files(run) == files
    other = write_run(tmp_path / "vdn" / "coop_nav")
    assert group_files([other], "algorithm/task")["coop_nav"]["vdn"] == curve_files(other)
    with pytest.raises(SchemaError, match="is no training run with a learning curve"):
        curve_files(tmp_path)
    (files[1]).unlink()
    with pytest.raises(SchemaError, match="is no training run with a learning curve"):
        curve_files(run)


def test_runs_and_files_are_drawn_together(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="figures need the plots extra")
    run = write_run(tmp_path / "mappo")
    copy = tmp_path / "vdn.csv"
    copy.write_text((run / "seeds-0" / "curve.csv").read_text())
    draw_training([run, copy], "success", tmp_path / "curves.svg")
    assert (tmp_path / "curves.svg").stat().st_size > 1000
    with pytest.raises(SchemaError, match="several curves are called mappo"):
        draw_training([run, tmp_path / "mappo.csv"], "success", tmp_path / "curves.svg")


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_interval_holds_the_mean_and_moves_with_the_runs(seed: int, n_runs: int) -> None:
    values = np.random.default_rng(seed).normal(size=(n_runs, 7))
    low, high = interval_of(Curve(np.arange(7.0), values))
    mean = values.mean(axis=0)
    if n_runs == 1:
        assert np.isnan([low, high]).all()
        return
    assert (low < mean).all()
    np.testing.assert_allclose(high - mean, mean - low)
    shifted = interval_of(Curve(np.arange(7.0), values + 5.0))
    np.testing.assert_allclose(shifted[0], low + 5.0)


def test_the_band_of_a_share_ends_at_none_and_all() -> None:
    curve = Curve(np.arange(2.0), np.array([[0.0, 1.0], [0.5, 0.2]]))
    low, high = interval_of(curve, SHARE)
    assert interval_of(curve)[0].min() < 0.0 == low.min()
    assert high.max() == 1.0


def write_runs(folder: Path, seeds: int = 2) -> dict[str, dict[str, list[Path]]]:
    curves: dict[str, dict[str, list[Path]]] = {}
    for task in ("coop_nav", "formation"):
        for algorithm in ("mappo", "vdn"):
            file = folder / f"{task}-{algorithm}.csv"
            rows = [
                f"{frames},{seed},{frames / 1e6},{frames / 1e5 - seed}"
                for seed in range(seeds)
                for frames in (100_000, 500_000, 900_000)
            ]
            file.write_text("frames,seed,success,return\n" + "\n".join(rows) + "\n")
            curves.setdefault(task, {})[algorithm] = [file]
    return curves


@pytest.mark.parametrize("log", [False, True])
def test_figure_names_tasks_algorithms_and_runs(tmp_path: Path, log: bool) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "learning.svg"
    plot_learning(write_runs(tmp_path), out, log=log)
    text = out.read_text()
    for label in ("coop_nav", "formation", "team success (%)", "team return"):
        assert f"<!-- {label} -->" in text
    for label in ("mappo (2 runs)", "vdn (2 runs)"):
        assert text.count(f"<!-- {label} -->") == 4


def test_malformed_files_leave_no_figure(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    curves = write_runs(tmp_path)
    curves["coop_nav"]["vdn"][0].write_text("frames,success\n1,0.5\n")
    with pytest.raises(SchemaError, match="column 'return' is None"):
        plot_learning(curves, tmp_path / "x.png")
    with pytest.raises(SchemaError, match="no curves to draw"):
        plot_learning({}, tmp_path / "x.png")
    with pytest.raises(SchemaError, match="no curves to draw"):
        plot_learning({"coop_nav": {}}, tmp_path / "x.png")
    assert not (tmp_path / "x.png").exists()
