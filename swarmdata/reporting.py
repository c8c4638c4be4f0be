"""From result files and run folders to tables, pictures and animations on disk."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from swarmdata.behavior_policies.tiers import SPECS, is_dataset
from swarmdata.cards.schema import TaskReferences, references_of
from swarmdata.catalog import load as load_dataset
from swarmdata.clips import check_clip, write_clip
from swarmdata.errors import DatasetNotFoundError, SchemaError
from swarmdata.evaluate import load, load_metadata
from swarmdata.learning_curves import group_files, plot_learning
from swarmdata.metrics import Reference
from swarmdata.models import Source, is_same_world, with_models
from swarmdata.plots import plot_curves, plot_estimates, read_curve
from swarmdata.presets import find_spec
from swarmdata.registry import make_env
from swarmdata.reobserve import seen_again
from swarmdata.report import Table, results_table
from swarmdata.rollout import rollout
from swarmdata.seeding import evaluation_seeds
from swarmdata.spec import TaskSpec
from swarmdata.targets import find_target
from swarmdata.types import Episode, EvalResult


def compare(results: Mapping[str, Sequence[EvalResult]], spec: TaskSpec) -> Table:
    """Returns the results as a table, with scores where the world has measured references.

    Models change neither rewards nor returns, so a policy that sees less is scored on the scale of
    the headline spec: the loss shows.
    """
    return results_table(results, spec, reference=reference_of(spec))


def reference_of(spec: TaskSpec) -> Reference | None:
    """The returns of no skill and of the expert in the world of a spec, None if not measured."""
    known = _references(spec)
    if known is None or known.no_skill is None or known.expert is None:
        return None
    return Reference(known.no_skill, known.expert)


def _references(spec: TaskSpec) -> TaskReferences | None:
    """Those of the spec itself, else of the headline spec of the same world."""
    worlds = [known for known in SPECS.values() if is_same_world(known, spec)]
    found = (references_of(each.hash()) for each in (spec, *worlds))
    return next((references for references in found if references is not None), None)


def write_report(results: Path, out: Path, runs: Sequence[Path], task: str) -> Table:
    """Writes `table.md`, `table.csv` and `table.png`, and `curves.png` if there are runs.

    Args:
        results: folder of result files, as `evaluate` saves them.
        out: folder to write to.
        runs: training runs whose learning curves are drawn together.
        task: that the results are of: a preset's name, or a spec's file; the models that the
            results were measured under are read from their files.

    Raises:
        DatasetNotFoundError: there are no results.
        SchemaError: results that cannot be compared.
    """
    spec = find_spec(task)
    files = _files(results)
    models = load_metadata(files[0]).get("models", {})
    table = compare(_read(files), with_models(spec, **models))
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


def _files(folder: Path) -> list[Path]:
    files = sorted(folder.glob("*.json"))
    if not files:
        raise DatasetNotFoundError(
            f"{folder} holds no results. Write some with: swarmdata evaluate ... --out {folder}"
        )
    return files


def _read(files: Sequence[Path]) -> dict[str, list[EvalResult]]:
    """Results by policy label; the order of labels is that of their returns, lowest first."""
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


def draw_learning(files: Sequence[Path], by: str, out: Path, *, log: bool = False) -> None:
    """Draws success and return of online runs by task and algorithm.

    Args:
        files: CSV files with a `frames` column; with a `seed` column for several runs in one.
        by: how the files are named; see `learning_curves.group_files`.
        out: the picture.
        log: whether joint steps are logarithmic.
    """
    plot_learning(group_files(files, by), out, log=log)


def draw_target(
    name: str,
    out: Path,
    index: int,
    task: str,
    observation: Source | None = None,
    communication: Source | None = None,
    *,
    size: int = 384,
    stride: int = 2,
) -> Episode:
    """Draws an episode, with lidar rays and messages where there are any; returns it.

    Args:
        name: a dataset's id for a recorded episode, else as `targets.find_target`.
        out: the `.gif`, `.mp4` or `.png` file.
        index: of the recorded episode, or of the reserved evaluation seed.
        task: of policies and tiers: a preset's name, or a spec's file.
        observation: what the robots sense; a recorded episode is observed again.
        communication: what they hear; the same.
        size: pixels of the arena's longer side.
        stride: control steps between two pictures of an animation.

    Raises:
        SchemaError: another kind of file, or no such episode.
    """
    check_clip(out)
    if is_dataset(name):
        dataset = load_dataset(name)
        if index >= len(dataset):
            raise SchemaError(f"{dataset.id} has {len(dataset)} episodes, none numbered {index}")
        spec = with_models(dataset.task, observation, communication)
        episode = seen_again(dataset[index], dataset.task, spec)
    else:
        target = find_target(name, task, observation, communication)
        spec, seeds = target.spec, evaluation_seeds(index + 1)[index:]
        (episode,) = rollout(make_env(spec), target.policies[0], seeds)
    write_clip(episode, spec, out, size=size, stride=stride)
    return episode
