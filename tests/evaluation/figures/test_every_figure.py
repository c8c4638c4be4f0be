"""Each kind of figure, filled as large studies fill it: no label is cut off or covers another."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="figures need the plots extra")

from swarmdata.drawing.style import FAMILY_OF, family_colors, family_looks
from swarmdata.evaluation.figures import dot_plot, front_plot, line_plot, matrix_plot
from swarmdata.evaluation.figures.dot_plot import plot_by_dataset
from swarmdata.evaluation.figures.front_plot import FrontPanel, plot_fronts
from swarmdata.evaluation.figures.matrix_plot import MatrixCell, Notes, plot_matrix
from swarmdata.evaluation.results import result_plots
from swarmdata.evaluation.results.estimate_table import Column
from swarmdata.evaluation.results.learning_curves import Curve, plot_curves, plot_learning
from swarmdata.evaluation.results.result_plots import (
    plot_differences,
    plot_estimates,
    plot_score_profiles,
)
from swarmdata.evaluation.robustness.sweep_plots import plot_degradation
from swarmdata.evaluation.robustness.sweep_tables import read_csv
from swarmdata.evaluation.study.pages.row_differences import RowDifference, plot_row_differences
from swarmdata.evaluation.study.pages.training_curves import plot_training_curves
from swarmdata.evaluation.study.shifts.sweeps import plot_sweeps
from tests.evaluation.figures.conftest import Shown
from tests.support.drawn import label_faults
from tests.support.measured import at

ROOT = Path(__file__).parents[3]
LABELS = [name for name in FAMILY_OF if name not in ("mappo", "maddpg")]
LOOKS = family_looks(FAMILY_OF)
TASKS = ("coop_nav", "formation", "transport", "warehouse")

CONDITIONS = ("coop_nav", "coop_nav~lidar-16~none", "coop_nav~state+no-velocities~errand+lossy-60",
              "coop_nav~state+goal-for-0+no-velocities~errand+expires-0")  # fmt: skip
DATASETS = [f"{task}-{tier}" for task in TASKS for tier in
            ("medium-replay", "medium-expert", "expert", "lanes-two-conventions")]  # fmt: skip
SWEEPS = sorted((ROOT / "cards/studies/robustness/sweeps").glob("*/sweep.csv"))


def dots(path: Path) -> None:
    found = {name: {label: at(9.0 * k) for k, label in enumerate(LABELS)} for name in DATASETS[:4]}
    plot_by_dataset(found, {}, LOOKS, path, label="score", families=FAMILY_OF)


def many_rows(path: Path) -> None:
    labels = {f"maddpg_bc-setting-{k}": "actor-critic" for k in range(36)}
    found = {DATASETS[0]: {label: at(float(k)) for k, label in enumerate(labels)}}
    plot_by_dataset(found, {DATASETS[0]: 3.0}, family_looks(labels), path, label="score")


def matrix(path: Path) -> None:
    families: dict[str, list[str]] = {}
    for label in LABELS:
        families.setdefault(FAMILY_OF[label], []).append(label)
    cells = {
        (dataset, label): MatrixCell(-110.0 + 12 * i, -60.0 + 8 * i, i % 3 == 0)
        for dataset in DATASETS
        for i, label in enumerate(LABELS[:-1])
    }
    rows = {task: [name for name in DATASETS if name.startswith(task)] for task in TASKS}
    colors, side = family_colors(tuple(families)), dict.fromkeys(DATASETS, -81.0)
    words = "score minus the mean of the data", "framed: the best; dot: not run"
    notes = Notes(60.0, *words, colors, side, "data")
    plot_matrix(cells, rows, families, path, notes)


def small_fronts(path: Path) -> None:
    points = {label: (at(0.1 * k, 0.05), at(9.0 - k)) for k, label in enumerate(LABELS)}
    panels = {name: FrontPanel(points, LABELS[:2], 4.0) for name in DATASETS}
    plot_fronts(panels, LOOKS, path, xlabel="collisions", ylabel="return")


def large_fronts(path: Path) -> None:
    points = {label: (at(0.4 * k, 0.05), at(9.0 - 2 * k)) for k, label in enumerate(LABELS[:4])}
    panels = {name: FrontPanel(points, LABELS[:2]) for name in DATASETS[:4]}
    plot_fronts(panels, LOOKS, path, xlabel="collisions", ylabel="return")


def curves(path: Path) -> None:
    """Lines of different lengths that end at almost the same height."""
    lengths = {"mappo": 5e6, "maddpg": 1e6, "vdn": 1e6, "qmix": 3e5}
    lines = {
        name: Curve(np.linspace(0, end, 9), np.linspace(0, 0.9 + 0.01 * k, 9)[None].repeat(2, 0))
        for k, (name, end) in enumerate(lengths.items())
    }
    plot_training_curves(dict.fromkeys(CONDITIONS, lines), LOOKS, path, "success (%)",
                         factor=100.0, n_columns=2, xlabel="joint steps")  # fmt: skip


def trials(path: Path) -> None:
    """The curve of a tuning with three trials."""
    found = Curve(np.arange(1.0, 4.0), np.array([[40.0, 41.0, 41.5]]))
    plot_curves({"validation episodes": found, "the data alone": found}, path, xlabel="trials",
                ylabel="expected score", references={"default": 40.1})  # fmt: skip


def online(path: Path) -> None:
    files: dict[str, dict[str, list[Path]]] = {}
    for task in TASKS[:3]:
        for k, name in enumerate(("mappo", "maddpg", "vdn", "qmix")):
            file = path.with_name(f"{task}-{name}.csv")
            rows = [f"{1e5 * n},{seed},{0.1 * n},{n - k}\n" for seed in (0, 1) for n in range(1, 9)]
            file.write_text("frames,seed,success,return\n" + "".join(rows))
            files.setdefault(task, {})[name] = [file]
    plot_learning(files, path)


def panels(path: Path) -> None:
    rows = {label: at(9.0 * k) for k, label in enumerate(LABELS)}
    names = ("score", "success (%)", "clean success (%)", "robot collisions")
    plot_estimates(dict.fromkeys(names, rows), path, looks=LOOKS)


def profiles(path: Path) -> None:
    plot_score_profiles({name: np.full((2, 1, 3), 9.0 * k) for k, name in enumerate(LABELS)},
                        LOOKS, path)  # fmt: skip


def pairs(path: Path) -> None:
    plot_differences({f"{name}-fast-4x": np.full((2, 1, 3), 9.0 * k)
                      for k, name in enumerate(LABELS)}, path)  # fmt: skip


def differences(n_datasets: int, n_pairs: int) -> Callable[[Path], None]:
    columns = [Column("score", "score", "", 1), Column("success", "success", "%", 1, 100.0)]

    def draw(path: Path) -> None:
        found = [
            RowDifference(f"{name}-fast-4x", f"{name}-fast-2x", dataset,
                          {"score": at(3.0 * k), "success": at(0.05 * k, 0.02)})
            for dataset in DATASETS[:n_datasets]
            for k, name in enumerate(LABELS[:n_pairs])
        ]  # fmt: skip
        plot_row_differences(found, columns, path)

    return draw


def sweeps(path: Path) -> None:
    found = list(map(read_csv, SWEEPS))
    plot_sweeps(found, family_looks({**FAMILY_OF, "bc-gru": "recurrent cloning"}), path)


def one_sweep(path: Path) -> None:
    plot_degradation(read_csv(SWEEPS[0]), path)


@pytest.mark.parametrize(
    ("module", "draw"),
    [
        (dot_plot, dots),
        pytest.param(dot_plot, many_rows, marks=pytest.mark.slow),
        (matrix_plot, matrix),
        pytest.param(front_plot, small_fronts, marks=pytest.mark.slow),
        pytest.param(front_plot, large_fronts, marks=pytest.mark.slow),
        (line_plot, curves),
        pytest.param(line_plot, trials, marks=pytest.mark.slow),
        pytest.param(line_plot, online, marks=pytest.mark.slow),
        pytest.param(dot_plot, panels, marks=pytest.mark.slow),
        (result_plots, profiles),
        pytest.param(matrix_plot, pairs, marks=pytest.mark.slow),
        pytest.param(dot_plot, differences(1, 9), marks=pytest.mark.slow),
        pytest.param(dot_plot, differences(4, 9), marks=pytest.mark.slow),
        pytest.param(matrix_plot, differences(12, 9), marks=pytest.mark.slow),
        pytest.param(line_plot, sweeps, marks=pytest.mark.slow),
        pytest.param(line_plot, one_sweep, marks=pytest.mark.slow),
    ],
)
def test_labels_are_whole_and_apart_on_one_screen(
    module: ModuleType, draw: Callable[[Path], None], shown: Shown
) -> None:
    drawing = shown(module, draw)
    assert label_faults(drawing) == []
    assert drawing.get_figheight() <= 6.0, "1,200 pixels"


@pytest.mark.slow
def test_lines_that_end_early_are_joined_to_their_labels(shown: Shown) -> None:
    panels = shown(line_plot, curves).axes
    leaders = [sum(not text.get_text() for text in axes.texts) for axes in panels]
    assert leaders == [3] * len(CONDITIONS)  # of 4 lines


@pytest.mark.slow
def test_ticks_of_counts_are_whole_numbers(shown: Shown) -> None:
    (axes,) = shown(line_plot, trials).axes
    assert all(tick == round(tick) for tick in axes.get_xticks())
