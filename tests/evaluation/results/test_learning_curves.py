"""The figure of online learning: files become lines, lines become a picture."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SchemaError
from swarmdata.evaluation.results.curve_plots import plot_learning
from swarmdata.evaluation.results.learning_curves import Curve, interval_of
from swarmdata.rollouts.score_intervals import SHARE


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
    curves = write_runs(tmp_path)
    curves["coop_nav"]["vdn"][0].write_text("frames,success\n1,0.5\n")
    with pytest.raises(SchemaError, match="column 'return' is None"):
        plot_learning(curves, tmp_path / "x.png")
    with pytest.raises(SchemaError, match="no curves to draw"):
        plot_learning({}, tmp_path / "x.png")
    with pytest.raises(SchemaError, match="no curves to draw"):
        plot_learning({"coop_nav": {}}, tmp_path / "x.png")
    assert not (tmp_path / "x.png").exists()
