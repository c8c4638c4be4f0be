"""Figures hold the data they were given, in every format."""

import sys
from pathlib import Path

import numpy as np
import pytest

from swarmdata.errors import MissingExtraError, SchemaError
from swarmdata.evaluation.results.curve_plots import plot_curves
from swarmdata.evaluation.results.learning_curves import Curve, read_curve
from swarmdata.evaluation.results.result_plots import plot_estimates
from swarmdata.rollouts.score_statistics import Estimate

pytest.importorskip("matplotlib")

MAGIC = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
CURVE = Curve(np.arange(0.0, 5000.0, 1000.0), np.random.default_rng(0).random((3, 5)))
PANELS = {
    "score": {
        "scripted": Estimate(90.0, 88.0, 92.0),
        "behavior cloning": Estimate(60.0, 50.0, 66.0),
    },
    "success (%)": {
        "scripted": Estimate(80.0, 70.0, 90.0),
        "behavior cloning": Estimate(50.0, 40.0, 60.0),
    },
}


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_seeds_of_one_file_become_runs(tmp_path: Path) -> None:
    text = "updates,seed,success\n0,1,0.1\n0,2,0.2\n10,2,0.4\n10,1,0.3\n"
    curve = read_curve([write(tmp_path / "curve.csv", text)], "success")
    assert curve.progress.tolist() == [0, 10]
    assert curve.values.tolist() == [[0.1, 0.3], [0.2, 0.4]]


def test_files_without_seeds_are_one_run_each(tmp_path: Path) -> None:
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


@pytest.mark.parametrize("suffix", MAGIC)
def test_figures_are_saved_by_suffix(tmp_path: Path, suffix: str) -> None:
    plot_curves({"bc": CURVE}, tmp_path / f"a{suffix}", ylabel="success (%)", factor=100)
    plot_estimates(PANELS, tmp_path / f"b{suffix}")
    for name in "ab":
        assert (tmp_path / f"{name}{suffix}").read_bytes().startswith(MAGIC[suffix])


def text_of(path: Path) -> str:
    """An SVG whose letters are outlines still names them in comments."""
    return path.read_text()


def test_labels_units_and_references_are_in_the_picture(tmp_path: Path) -> None:
    path = tmp_path / "curves.svg"
    plot_curves({"BC": CURVE}, path, ylabel="success (%)", references={"dataset": 0.4})
    for label in ("BC (3 seeds)", "success (%)", "gradient updates", "dataset", "2k"):
        assert f"<!-- {label} -->" in text_of(path)
    plot_estimates(PANELS, tmp_path / "table.svg")
    for label in ("behavior cloning", "success (%)", "score"):
        assert f"<!-- {label} -->" in text_of(tmp_path / "table.svg")


def test_other_suffixes_and_empty_figures_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match=r"suffix '.jpg', expected one of"):
        plot_curves({"bc": CURVE}, tmp_path / "a.jpg", ylabel="y")
    with pytest.raises(SchemaError, match="no curves to draw"):
        plot_curves({}, tmp_path / "a.png", ylabel="y")
    short = {"time (s)": {"scripted": Estimate(6.0, 5.0, 7.0)}}
    wrong: list[dict[str, dict[str, Estimate]]] = [{}, {"score": {}}, {**PANELS, **short}]
    for panels in wrong:
        with pytest.raises(SchemaError, match="the same rows in every panel"):
            plot_estimates(panels, tmp_path / "a.png")
    assert not list(tmp_path.iterdir())


def test_without_matplotlib_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'swarmdata\[plots\]'"):
        plot_curves({"bc": CURVE}, tmp_path / "a.png", ylabel="y")
