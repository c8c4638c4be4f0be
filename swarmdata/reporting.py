"""From result files and run folders to tables, pictures and animations on disk."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from swarmdata.behavior_policies.tiers import SPECS, is_dataset
from swarmdata.cards.schema import references_of
from swarmdata.catalog import load as load_dataset
from swarmdata.envs.render import animate
from swarmdata.errors import DatasetNotFoundError, SchemaError, UnknownNameError
from swarmdata.evaluate import load
from swarmdata.metrics import Reference
from swarmdata.plots import plot_curves, plot_estimates, read_curve
from swarmdata.registry import make_env
from swarmdata.report import Table, results_table
from swarmdata.rollout import rollout
from swarmdata.seeding import evaluation_seeds
from swarmdata.spec import TaskSpec
from swarmdata.targets import find_target
from swarmdata.types import EvalResult


def compare(results: Mapping[str, Sequence[EvalResult]], spec: TaskSpec) -> Table:
    """Returns the results as a table, with scores where the spec has measured references."""
    known = references_of(spec.hash())
    if known is None or known.no_skill is None or known.expert is None:
        return results_table(results, spec)
    return results_table(results, spec, reference=Reference(known.no_skill, known.expert))


def write_report(results: Path, out: Path, runs: Sequence[Path], task: str) -> Table:
    """Writes `table.md`, `table.csv` and `table.png`, and `curves.png` if there are runs.

    Args:
        results: folder of result files, as `evaluate` saves them.
        out: folder to write to.
        runs: training runs whose learning curves are drawn together.
        task: that the results are of.

    Raises:
        DatasetNotFoundError: there are no results.
        SchemaError: results that cannot be compared.
    """
    if task not in SPECS:
        raise UnknownNameError("task", task, SPECS)
    table = compare(_read(results), SPECS[task])
    out.mkdir(parents=True, exist_ok=True)
    (out / "table.md").write_text(table.to_markdown(), encoding="utf-8")
    (out / "table.csv").write_text(table.to_csv(), encoding="utf-8")
    keys = [column.key for column in table.columns][:2]
    plot_estimates(table.panels(keys), out / "table.png")
    if runs:
        curves = {
            run.resolve().name: read_curve([run / "curve.csv"], "success", progress="update")
            for run in runs
        }
        plot_curves(curves, out / "curves.png", ylabel="team success (%)", factor=100.0)
    return table


def _read(folder: Path) -> dict[str, list[EvalResult]]:
    """Results by policy label; the order of labels is that of their returns, lowest first."""
    files = sorted(folder.glob("*.json"))
    if not files:
        raise DatasetNotFoundError(
            f"{folder} holds no results. Write some with: swarmdata evaluate ... --out {folder}"
        )
    groups: dict[str, list[EvalResult]] = {}
    for file in files:
        result = load(file)
        groups.setdefault(result.policy, []).append(result)
    return dict(sorted(groups.items(), key=lambda item: _mean_return(item[1])))


def _mean_return(group: Sequence[EvalResult]) -> float:
    return sum(float(result.metrics["return"].mean()) for result in group) / len(group)


def draw_training(files: Sequence[Path], metric: str, out: Path) -> None:
    """Draws the curves of online runs, one line each, by the stem of their `curve.csv` copies.

    Args:
        files: CSV files with a `frames` column.
        metric: column to draw; a share in [0, 1] unless it is `return`.
        out: the picture.
    """
    curves = {file.stem: read_curve([file], metric, progress="frames") for file in files}
    is_return = metric == "return"
    plot_curves(
        curves,
        out,
        ylabel="team return" if is_return else f"{metric.replace('_', ' ')} (%)",
        xlabel="joint steps of training",
        factor=1.0 if is_return else 100.0,
    )


def animate_target(name: str, out: Path, index: int, task: str) -> None:
    """Writes an episode as a GIF.

    Args:
        name: a dataset's id for a recorded episode, else as `targets.find_target`.
        out: the `.gif` file.
        index: of the recorded episode, or of the reserved evaluation seed.
        task: of policies and tiers.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    if is_dataset(name):
        dataset = load_dataset(name)
        if index >= len(dataset):
            raise SchemaError(f"{dataset.id} has {len(dataset)} episodes, none numbered {index}")
        animate(dataset[index], dataset.spec, out)
        return
    target = find_target(name, task)
    seeds = evaluation_seeds(index + 1)[index:]
    (episode,) = rollout(make_env(target.spec), target.policies[0], seeds)
    animate(episode, target.spec, out)
