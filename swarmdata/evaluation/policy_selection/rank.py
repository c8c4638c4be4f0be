"""Ranks the policies of offline runs on the validation split of their dataset, without a simulator.

After Paine et al., "Hyperparameter Selection for Offline Reinforcement Learning", 2020.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata import __version__
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError, SpecError, UnknownNameError
from swarmdata.evaluation.policy_selection.rank_statistics import (
    pessimistic_value,
    rank_correlation,
    regret,
)
from swarmdata.evaluation.policy_selection.ranking_record import (
    CRITERIA,
    Criterion,
    CriterionQuality,
    Interval,
    RankedPolicy,
    Ranking,
)
from swarmdata.evaluation.results.result_files import load_result
from swarmdata.hub.catalog.catalog import load
from swarmdata.learn.evaluation.fqe import (
    Answered,
    FQEConfig,
    Values,
    fitted_q_evaluation,
    imitation_error,
    td_errors,
    weighted_imitation_error,
)
from swarmdata.learn.evaluation.transitions import Transitions
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.training.run_files import run_hash, run_names
from swarmdata.learn.training.run_folder import (
    Loaded,
    kept_updates,
    load_algorithm,
    load_last,
    read_run,
)
from swarmdata.learn.training.training_data import framed
from swarmdata.registry.published import normalized_score
from swarmdata.rollouts.evaluate import check_comparable, evaluate
from swarmdata.rollouts.score_intervals import mean_interval
from swarmdata.runtime.documents import parse_json
from swarmdata.runtime.native_libraries import ThreadLimit
from swarmdata.specs.origins import SideSpec, Spec
from swarmdata.store.split_rule import empty_validation
from swarmdata.types import Double, EvalResult, check_device

TOP = (1, 3)  # values of k for regret@k; those above n - 1 leave no choice and are left out

RECORDED_SETTINGS = ("n_updates", "batch_size", "hidden", "n_fits", "discount")
"""Settings of the fitted Q evaluation that the record has."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """The policies of one checkpoint of a run, one per seed, in the order of the run's seeds."""

    name: str  # of the run
    content: str | None  # SHA-256 of the run's files; None for an earlier checkpoint
    loaded: Loaded
    td_error: Double | None  # [K] on the validation split, if there are critics


def rank(
    folders: Sequence[Path],
    *,
    dataset_id: str | None = None,
    config: FQEConfig | None = None,
    by: Criterion = "fqe",
    checkpoints: bool = False,
    n_episodes: int | None = None,
    results: Path | None = None,
    device: str = "cpu",
    progress: bool = True,
) -> Ranking:
    """Ranks all seeds of offline runs, by their last or all kept `checkpoints`, on one dataset.

    It is the one that the runs name, or `dataset_id`, as `load` takes it. Scores, which tell how
    well each criterion ranks, are simulated on `n_episodes` reserved seeds, or read from `results`,
    a folder that `evaluate --out` wrote.

    Raises:
        CheckpointError: a folder holds no run, or a damaged one.
        SpecError: `n_episodes` with a recording of another environment, or of one side.
    """
    config = config or FQEConfig()
    if n_episodes is not None and results is not None:
        raise SchemaError("got n_episodes and results, expected one of them: both provide scores")
    check_device(device)
    dataset = _dataset(folders, dataset_id, progress=progress)
    _check_no_side(dataset, n_episodes)
    parts = dataset.split("train"), dataset.split("validation")
    if not len(parts[1]):
        raise SchemaError(f"{dataset.id}: {empty_validation(len(dataset))}")
    with ThreadLimit():
        found = _candidates(folders, parts[1], checkpoints=checkpoints, device=device)
        values, held_out = _values(found, parts, config, device, progress=progress)
    measured = _measure(found, dataset, n_episodes, results, progress=progress)
    rows = _rows(found, values, held_out, _scores(dataset, measured))
    return Ranking(
        code_version=__version__,
        dataset=dataset.id,
        digest=dataset.digest,
        view=dataset.view,
        by=by,
        n_validation_episodes=len(parts[1]),
        **{name: getattr(config, name) for name in RECORDED_SETTINGS},
        bound=values.bound,
        data_value=float(held_out.data.initial_returns.mean()),
        **_scale(dataset, measured),
        policies=_sorted(rows, by),
        quality=_qualities(rows),
    )


def _check_no_side(dataset: Dataset, n_episodes: int | None) -> None:
    if n_episodes is not None and isinstance(dataset.spec, SideSpec):
        raise SpecError(
            f"got {n_episodes} episodes for policies of {dataset.spec.task}, which need opponents. "
            "Evaluate the runs first (swarmdata evaluate RUN --opponents NAME --out FOLDER), and "
            "give that folder as results (--results)."
        )


def _dataset(folders: Sequence[Path], dataset_id: str | None, *, progress: bool) -> Dataset:
    """Loads the dataset that all runs learned from, re-observed as in their training."""
    runs = [read_run(folder) for folder in folders]
    first = runs[0]
    for folder, run in zip(folders, runs, strict=True):
        if (run.digest, run.view) != (first.digest, first.view):
            raise SchemaError(
                f"{folder} was trained on {run.dataset} (digest {run.digest[:12]}, view {run.view})"
                f", {folders[0]} on {first.dataset} (digest {first.digest[:12]}, view {first.view})"
                ". Rank only runs of one dataset and one view: values on different data cannot be "
                "compared."
            )
    models: dict[str, Any] = {} if first.view is None else parse_json(first.view, "the view")
    if "mixture" in models:
        raise SchemaError(
            f"{folders[0]} was trained on a mixture, {first.dataset}, expected a dataset: "
            "values of policies are estimated on one recording."
        )
    try:
        dataset = load(dataset_id or first.dataset, **models, progress=progress)
    except UnknownNameError as error:
        if dataset_id is not None:
            raise
        raise SchemaError(
            f"{folders[0]} was trained on {first.dataset}, which is neither in the cache nor on a "
            "remote: give the folder of that dataset (--dataset)"
        ) from error
    if dataset.digest != first.digest:
        raise SchemaError(
            f"{dataset!r} is not the dataset that {folders[0]} was trained on: {first.dataset}, "
            f"digest {first.digest[:12]}. Pass that dataset or its folder."
        )
    return dataset


def _candidates(
    folders: Sequence[Path], held_out: Dataset, *, checkpoints: bool, device: str
) -> list[Candidates]:
    """Loads the last checkpoint of each run, or all that it kept and the last."""
    found = []
    for name, folder in zip(run_names(folders), folders, strict=True):
        last = load_last(folder, device)
        kept = kept_updates(folder) if checkpoints else ()
        earlier = (load_algorithm(folder, device, at) for at in kept if at != last.update)
        for loaded in (*earlier, last):
            n_seeds = len(loaded.run.seeds)
            dataset = framed(held_out, loaded.run.frame)
            error = None  # a run that was made small has no critics left
            if not loaded.is_compact:
                error = td_errors(loaded.algorithm, dataset, n_seeds, device)
            content = run_hash(folder, 0) if loaded is last else None
            found.append(Candidates(name, content, loaded, error))
    return found


def _values(
    found: Sequence[Candidates],
    parts: Sequence[Dataset],
    config: FQEConfig,
    device: str,
    *,
    progress: bool,
) -> tuple[Values, Answered]:
    """What the policies are worth, fitted on the first part, and their answers on the second."""
    policies = [policy for each in found for policy in each.loaded.policies]
    statistics = Statistics.measure(parts[0], config.discount)
    train, held_out = (
        Answered.by(policies, part, Transitions.read(part, statistics, config.discount, device))
        for part in parts
    )
    scale = statistics.return_std
    return fitted_q_evaluation(train, held_out, scale, config, progress=progress), held_out


def _rows(
    found: Sequence[Candidates],
    values: Values,
    held_out: Answered,
    scores: Sequence[float | None],
) -> list[RankedPolicy]:
    """One row per policy, in the order of the candidates."""
    imitation, weighted = imitation_error(held_out), weighted_imitation_error(held_out)
    rows: list[RankedPolicy] = []
    for each in found:
        run = each.loaded.run
        for index, seed in enumerate(run.seeds):
            k = len(rows)
            rows.append(
                RankedPolicy(
                    run=each.name,
                    run_hash=run.hash(),
                    algorithm=run.algorithm,
                    seed=seed,
                    update=each.loaded.update,
                    fqe=_over_states(values.values[k]),
                    fqe_pessimistic=pessimistic_value(values.values[k]),
                    fqe_curve=tuple(values.curve[:, k].mean(1).tolist()),
                    fqe_residual=float(values.residual[k].mean()),
                    fqe_clipped=float(values.clipped[k].mean()),
                    imitation_error=float(imitation[k]),
                    weighted_imitation_error=float(weighted[k]),
                    td_error=None if each.td_error is None else float(each.td_error[index]),
                    score=scores[k],
                )
            )
    return rows


def _over_states(values: Double) -> Interval:
    """The mean over fits [M] and initial states [E], with its interval for new initial states."""
    value, low, high = mean_interval(values.mean(axis=0)[None])
    if values.shape[1] == 1:  # no interval, but a record has numbers only
        return value, value, value
    return value, low, high


def _oriented(row: RankedPolicy, criterion: Criterion) -> float | None:
    """The value of a criterion with its sign changed so that more is better; None if unknown."""
    value = row.fqe[0] if criterion == "fqe" else getattr(row, criterion)
    return value if value is None or CRITERIA[criterion][1] else -value


def _sorted(rows: Sequence[RankedPolicy], by: Criterion) -> tuple[RankedPolicy, ...]:
    """Sorts the best first; policies without the criterion come last."""
    keys = [_oriented(row, by) for row in rows]
    if all(key is None for key in keys):
        algorithms = sorted({row.algorithm for row in rows})
        raise SchemaError(
            f"no policy here has a {CRITERIA[by][0]}: {algorithms} do not measure it. Rank by "
            "another criterion."
        )
    order = sorted(range(len(rows)), key=lambda k: np.inf if keys[k] is None else -keys[k])  # type: ignore[operator]
    return tuple(rows[k] for k in order)


def _qualities(rows: Sequence[RankedPolicy]) -> dict[Criterion, CriterionQuality]:
    """How well each criterion ranked the policies that have it and a score, if there are two."""
    qualities: dict[Criterion, CriterionQuality] = {}
    for criterion in CRITERIA:
        pairs = [(_oriented(row, criterion), row.score) for row in rows]
        known = [pair for pair in pairs if None not in pair]
        if len(known) < 2:
            continue
        estimates, scores = np.array(known, dtype=np.float64).T
        qualities[criterion] = CriterionQuality(
            n_policies=len(known),
            spearman=rank_correlation(estimates, scores),
            regret={k: regret(estimates, scores, k) for k in TOP if k < len(known)},
        )
    return qualities


def _measure(
    found: Sequence[Candidates],
    dataset: Dataset,
    n_episodes: int | None,
    folder: Path | None,
    *,
    progress: bool,
) -> Sequence[EvalResult | None]:
    """Results of the policies in the simulator or from files, if asked for; else of none."""
    policies = [policy for each in found for policy in each.loaded.policies]
    results: Sequence[EvalResult | None] = [None] * len(policies)
    if n_episodes is not None:
        options: dict[str, Any] = {"n_episodes": n_episodes, "progress": progress}
        results = [
            evaluate(policy, dataset.task, name=f"policy {k} of {len(policies)}", **options)
            for k, policy in enumerate(policies, 1)
        ]
    elif folder is not None:
        results = _read_results(found, dataset, folder)
    if measured := [result for result in results if result is not None]:
        check_comparable(measured)
    return results


def _scale(dataset: Dataset, results: Sequence[EvalResult | None]) -> dict[str, Any]:
    """The unit of the scores and their number of episodes, if there are scores."""
    measured = next((each for each in results if each is not None), None)
    if measured is None:
        return {}
    unit = "return" if dataset.references is None else "score"
    return {"score_unit": unit, "n_score_episodes": len(measured.seeds)}


def _scores(dataset: Dataset, results: Sequence[EvalResult | None]) -> list[float | None]:
    """The mean score of each result, or its mean return where the task has no references."""
    means = [None if each is None else float(each.metrics["return"].mean()) for each in results]
    scale = dataset.references  # policies are evaluated on the task's rewards, whatever the data's
    if scale is None:
        return means
    return [None if mean is None else float(normalized_score(mean, scale)) for mean in means]


def _without_opponents(spec: Spec) -> Spec:
    """The spec of results as data have it: those of one side name opponents, data do not."""
    return spec.model_copy(update={"opponents": None}) if isinstance(spec, SideSpec) else spec


def _read_results(
    found: Sequence[Candidates], dataset: Dataset, folder: Path
) -> list[EvalResult | None]:
    """Results of `evaluate --out` in the dataset's world and models; at least one must be there."""
    paths = sorted(folder.glob("*.json"))
    results = [
        each for each in map(load_result, paths) if _without_opponents(each.spec) == dataset.spec
    ]
    if len(played := sorted({each.spec.task for each in results})) > 1:
        raise SchemaError(
            f"{folder} holds results against several opponents ({', '.join(played)}), expected "
            "one: scores against different ones cannot be compared."
        )
    known = {(r.provenance.content, r.provenance.seed): r.evaluation for r in results}
    keys = [(each.content, seed) for each in found for seed in each.loaded.run.seeds]
    chosen = [None if key[0] is None else known.get(key) for key in keys]
    if all(each is None for each in chosen):
        raise SchemaError(
            f"{folder} holds {len(paths)} results, {len(results)} of them in the world and models "
            "of the data, but none of the last checkpoints of these runs. Evaluate these first: "
            "swarmdata evaluate RUN... --out FOLDER."
        )
    return chosen
