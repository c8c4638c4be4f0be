"""Learning curves: files become lines, lines become pictures in every format."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import MissingExtraError, SchemaError
from swarmdata.evaluation.results.learning_curves import (
    Curve,
    interval_of,
    plot_curves,
    plot_learning,
    read_curve,
)
from swarmdata.rollouts.score_intervals import SHARE

CURVE = Curve(np.arange(0.0, 5000.0, 1000.0), np.random.default_rng(0).random((3, 5)))


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


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
    files: dict[str, dict[str, list[Path]]] = {}
    for task in ("coop_nav", "formation"):
        for algorithm in ("mappo", "vdn"):
            file = folder / f"{task}-{algorithm}.csv"
            rows = [
                f"{frames},{seed},{frames / 1e6},{frames / 1e5 - seed}"
                for seed in range(seeds)
                for frames in (100_000, 500_000, 900_000)
            ]
            write(file, "frames,seed,success,return\n" + "\n".join(rows) + "\n")
            files.setdefault(task, {})[algorithm] = [file]
    return files


@pytest.mark.slow
def test_figure_names_tasks_algorithms_and_runs(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "learning.svg"
    plot_learning(write_runs(tmp_path), out)
    text = out.read_text()
    for label in ("coop_nav", "formation", "team success (%)", "team return"):
        assert f"<!-- {label} -->" in text
    for label in ("mappo (2 runs)", "vdn (2 runs)"):
        assert text.count(f"<!-- {label} -->") == 4


def test_malformed_files_leave_no_figure(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    files = write_runs(tmp_path)
    files["formation"]["vdn"][0].write_text("frames,success\n1,0.5\n")
    with pytest.raises(SchemaError, match="column 'return' is None"):
        plot_learning(files, tmp_path / "x.png")
    assert not (tmp_path / "x.png").exists()


def test_seeds_of_one_file_become_runs_and_files_without_seeds_are_one_each(tmp_path: Path) -> None:
    text = "updates,seed,success\n0,1,0.1\n0,2,0.2\n10,2,0.4\n10,1,0.3\n"
    curve = read_curve([write(tmp_path / "curve.csv", text)], "success")
    assert curve.progress.tolist() == [0, 10]
    assert curve.values.tolist() == [[0.1, 0.3], [0.2, 0.4]]
    paths = [write(tmp_path / f"{k}.csv", f"frames,r\n5,{k}\n9,{k + 1}\n") for k in range(3)]
    curve = read_curve(paths, "r", progress="frames")
    assert curve.values.tolist() == [[0, 1], [1, 2], [2, 3]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("updates,success\n0,high\n", r"line 2: column 'success' is 'high', expected a number"),
        ("updates,score\n0,1\n", "column 'success' is None.*Columns: updates, score"),
        ("updates,seed,success\n0,1,1\n0,2,1\n9,2,1\n", "differ from the 1 of the first run"),
        ("updates,success\n5,1\n5,2\n", "do not increase"),
        ("updates,success\n", "no rows"),
    ],
)
def test_malformed_curves_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SchemaError, match=message):
        read_curve([write(tmp_path / "curve.csv", text)], "success")


def test_labels_units_and_references_are_in_the_picture(tmp_path: Path) -> None:
    """An SVG whose letters are outlines still names them in comments."""
    pytest.importorskip("matplotlib")
    path = tmp_path / "curves.svg"
    plot_curves({"BC": CURVE}, path, ylabel="success (%)", references={"dataset": 0.4})
    for label in ("BC (3 seeds)", "success (%)", "gradient updates", "dataset", "2k"):
        assert f"<!-- {label} -->" in path.read_text()


def test_other_suffixes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match=r"suffix '.jpg', expected one of"):
        plot_curves({"bc": CURVE}, tmp_path / "a.jpg", ylabel="y")
    assert not list(tmp_path.iterdir())


def test_without_matplotlib_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'swarmdata\[plots\]'"):
        plot_curves({"bc": CURVE}, tmp_path / "a.png", ylabel="y")
