"""Reads folders of results into one set: by dataset and label, one result per training seed."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from swarmdata.errors import DatasetNotFoundError, SchemaError, UnknownNameError
from swarmdata.evaluation.results.result_checks import check_results
from swarmdata.evaluation.results.result_files import Result, load_result
from swarmdata.hub.catalog.catalog import find_folder
from swarmdata.registry.published import (
    Figures,
    Reference,
    TaskReferences,
    normalized_score,
    published,
    references_of,
)
from swarmdata.registry.recipes import FAMILY_SPECS, find_recipe
from swarmdata.specs.model_choice import is_same_world, with_models
from swarmdata.specs.origins import SideSpec, Spec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import open_store
from swarmdata.store.publication import figures_of
from swarmdata.types import Double, shortened


@dataclass(frozen=True, eq=False, repr=False)
class Case:
    """Results that can be compared: on one dataset, or in one spec if no data was used."""

    dataset: str | None  # `Provenance.dataset_key`
    spec: Spec  # of all evaluations
    reference: Reference | None  # of the score, if it was measured in this world
    data: Figures | None  # of the dataset's own episodes, if they are known
    runs: Mapping[str, tuple[Result, ...]]  # label -> one per training seed, by index
    recorded: Spec | None = None  # of the dataset, if it is known, with the models of its view

    def __repr__(self) -> str:
        """Shows the dataset and the labels."""
        return shortened(f"<Case {self.name}: results of {', '.join(self.runs)}>")

    @property
    def name(self) -> str:
        """The dataset, or the task."""
        return self.dataset or self.spec.task

    @property
    def view(self) -> dict[str, Any]:
        """Models of the dataset that were changed; empty: as recorded."""
        changes = next((self.runs[label][0].provenance.changes for label in self.trained), {})
        return {name: value for name, value in changes.items() if name != "rewards"}

    @property
    def rewards(self) -> dict[str, dict[str, Any]]:
        """Label -> what changed its rewards, of labels that learned from others than recorded."""
        changes = {label: self.runs[label][0].provenance.changes for label in self.trained}
        return {label: found["rewards"] for label, found in changes.items() if "rewards" in found}

    @property
    def trained(self) -> tuple[str, ...]:
        """Labels that learned from the dataset, without baselines."""
        named = self.runs.items()
        return tuple(label for label, runs in named if runs[0].provenance.dataset is not None)

    @property
    def world(self) -> TaskSpec | None:
        """The task of this package, of all sides; None: another environment."""
        return self.spec.whole if isinstance(self.spec, SideSpec) else self.spec.world

    @property
    def time_limit(self) -> float:
        """Duration of an unsolved episode, in seconds."""
        if self.spec.horizon is None or self.spec.time_step is None:
            raise SchemaError(
                f"{self.name} is an environment of another library, whose steps have no duration."
            )
        return self.spec.horizon * self.spec.time_step

    @property
    def data_score(self) -> float | None:
        """Score of the mean return of the dataset's episodes, with action noise.

        None for a side, whose recorded opponents are others than those of the references.
        """
        if self.data is None or self.reference is None or isinstance(self.spec, SideSpec):
            return None
        return float(normalized_score(self.data.mean_return, self.reference))

    def metric(self, label: str, name: str) -> Double:
        """Returns a metric of a label, [runs, episodes]."""
        if label not in self.runs:
            raise UnknownNameError(f"label of {self.name}", label, self.runs)
        rows = [result.evaluation.metrics for result in self.runs[label]]
        known = set(rows[0]).intersection(*rows)
        if name not in known:
            raise UnknownNameError("metric", name, known)
        return np.stack([row[name] for row in rows])

    def scores(self, label: str) -> Double:
        """Returns the scores of a label, [runs, episodes]."""
        if self.reference is None:
            raise SchemaError(
                f"{self.name} has no score: no references were measured in {self.spec.task} "
                f"{self.spec.hash()[:12]}. Use the return."
            )
        return normalized_score(self.metric(label, "return"), self.reference)


@dataclass(frozen=True, eq=False, repr=False)
class ResultSet:
    """Results that can be compared."""

    cases: tuple[Case, ...]  # of datasets, by task, then by the mean return of their data
    baselines: tuple[Case, ...]  # of policies that learned from no data, one per spec

    def __repr__(self) -> str:
        """Shows the datasets and the labels."""
        datasets = ", ".join(self.datasets) or "none"
        return shortened(f"<ResultSet of {', '.join(self.labels)} on datasets: {datasets}>")

    @property
    def datasets(self) -> tuple[str, ...]:
        """The keys of the datasets, in order."""
        return tuple(case.name for case in self.cases)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """The labels that learned from data, by their mean score (or return), the lowest first."""
        found: dict[str, list[float]] = {}
        for case in self.cases:
            for label in case.runs:
                is_scored = case.reference is not None
                values = case.scores(label) if is_scored else case.metric(label, "return")
                found.setdefault(label, []).append(float(values.mean()))
        return tuple(sorted(found, key=lambda label: (np.mean(found[label]), label)))

    @cached_property
    def scores(self) -> Mapping[str, Mapping[str, Double]]:
        """Label -> dataset -> scores [runs, episodes], of datasets that have a score."""
        scored = [case for case in self.cases if case.reference is not None]
        return {
            label: {case.name: case.scores(label) for case in scored if label in case.runs}
            for label in self.labels
        }

    def case(self, dataset: str) -> Case:
        """Returns the case of a dataset."""
        found = next((case for case in self.cases if case.name == dataset), None)
        if found is None:
            raise UnknownNameError("dataset with results", dataset, self.datasets)
        return found

    def with_baselines(self, case: Case) -> Case:
        """Adds the baselines of its spec to a case: policies that learned from no data come first.

        Labels of online algorithms get a suffix, because some offline algorithms have their names.
        """
        others = {
            f"{label} (online)" if runs[0].provenance.frames is not None else label: runs
            for each in self.baselines
            if each is not case and each.spec.hash() == case.spec.hash()
            for label, runs in each.runs.items()
        }
        return replace(case, runs=MappingProxyType({**others, **case.runs}))

    @property
    def results(self) -> tuple[Result, ...]:
        """All results."""
        groups = (runs for case in (*self.cases, *self.baselines) for runs in case.runs.values())
        return tuple(result for runs in groups for result in runs)


def read_results(folders: Iterable[Path | str], *, data: Sequence[Path | str] = ()) -> ResultSet:
    """Reads all results in folders that `evaluate` wrote, without their subfolders.

    Args:
        folders: with result files; a file is allowed as well.
        data: folders of datasets that are neither published nor in the cache, for their means.

    Raises:
        DatasetNotFoundError: a folder holds no results.
        SchemaError: a file is not a result.
        ResultsError: results are stale, or cannot be compared.
    """
    files = [file for folder in folders for file in _files(Path(folder))]
    return group_results([load_result(file) for file in files], data=data)


def group_results(
    results: Sequence[Result], *, data: Sequence[Path | str] = (), is_checked: bool = True
) -> ResultSet:
    """Groups results by dataset and label, as `read_results` does.

    Raises:
        ResultsError: `is_checked`, and results are stale, or cannot be compared.
    """
    if is_checked:
        check_results(results)
    groups: dict[tuple[str | None, str], list[Result]] = {}
    for result in results:
        key = result.provenance.dataset_key, result.evaluation.spec_hash
        groups.setdefault(key, []).append(result)
    cases = sorted((_case(group, data) for group in groups.values()), key=case_order)
    return ResultSet(
        cases=tuple(case for case in cases if case.dataset is not None),
        baselines=tuple(case for case in cases if case.dataset is None),
    )


def unique_names(cases: Sequence[Case]) -> list[str]:
    """Returns the names of cases, with the start of the spec's hash where several have one."""
    names = [case.name for case in cases]
    return [
        name if names.count(name) == 1 else f"{name}-{case.spec.hash()[:8]}"
        for name, case in zip(names, cases, strict=True)
    ]


def _files(path: Path) -> list[Path]:
    files = [path] if path.is_file() else sorted(path.glob("*.json"))
    if not files:
        raise DatasetNotFoundError(
            f"{path} holds no results. Write some with: swarmdata evaluate ... --out {path}"
        )
    return files


def _case(group: Sequence[Result], data: Sequence[Path | str]) -> Case:
    runs: dict[str, list[Result]] = {}
    for result in sorted(group, key=lambda each: each.provenance.index):
        runs.setdefault(result.provenance.label, []).append(result)
    provenance, spec = group[0].provenance, group[0].spec

    def mean_return(label: str) -> float:
        return float(np.mean([each.evaluation.metrics["return"].mean() for each in runs[label]]))

    figures, recorded = _data_facts(provenance.dataset, provenance.digest, data)
    changes = provenance.changes
    if "side" in changes or (recorded is not None and not _has_scale_of(recorded, spec)):
        figures = None  # they are of all sides, or of another task
    if recorded is not None and recorded.world is not None:
        models = (changes.get("observation"), changes.get("communication"))
        recorded = with_models(recorded.world, *models)
    ordered = {label: tuple(runs[label]) for label in sorted(runs, key=mean_return)}
    key, reference = provenance.dataset_key, reference_of(spec)
    return Case(key, spec, reference, figures, MappingProxyType(ordered), recorded)


def case_order(case: Case) -> tuple[str, int, float, str]:
    """Sorts by task and team size, then by the mean return of the data; unknown ones come last."""
    mean = case.data.mean_return if case.data is not None else float("inf")
    return case.spec.task, case.spec.n_agents, mean, case.name


def reference_of(spec: Spec) -> Reference | None:
    """Returns the reference of the score: of the spec, else of the headline spec of its world.

    Policies that observe less, act in another simulator, on wheels or with randomization are on the
    scale of the headline spec, so that the loss is visible. A side is on the scale of its
    references against the same opponents.
    """
    task = spec.whole if isinstance(spec, SideSpec) else spec.world
    if task is None:
        return None
    usual = _usual(task)
    worlds = [task, usual, *(each for each in FAMILY_SPECS.values() if is_same_world(each, usual))]
    sides = isinstance(spec, SideSpec)
    measured = (spec.model_copy(update={"whole": each}) if sides else each for each in worlds)
    found = (references_of(each.hash()) for each in measured)
    known: TaskReferences | None = next((each for each in found if each is not None), None)
    return None if known is None else known.reference


def _usual(task: TaskSpec) -> TaskSpec:
    """The task without wheels, other simulators and randomization, which leave the scale."""
    robots = [role.robot.model_copy(update={"base": "planar"}) for role in task.team]
    pairs = zip(task.team, robots, strict=True)
    team = tuple(role.model_copy(update={"robot": robot}) for role, robot in pairs)
    planar = task.model_copy(update={"team": team})
    return with_models(planar, backend="pymunk", randomization={})


def _has_scale_of(recorded: Spec, spec: Spec) -> bool:
    """Whether returns of recorded episodes compare with those that were measured in a spec."""
    first, second = recorded.world, spec.world
    if first is None or second is None:
        return True  # another environment
    return is_same_world(_usual(first), _usual(second))


def _data_facts(
    dataset: str | None, digest: str | None, folders: Sequence[Path | str]
) -> tuple[Figures | None, Spec | None]:
    """The figures of a dataset's own episodes and its spec: published, else from its files."""
    if dataset is None:
        return None, None
    entry = published().get(dataset)
    if entry is not None and entry.digest == digest:
        return entry, find_recipe(dataset).spec
    known = [Path(folder) for folder in folders]
    with suppress(UnknownNameError):  # an unpublished dataset outside the cache
        known += [each for each in (find_folder(dataset),) if (each / "manifest.json").exists()]
    for folder in known:
        stored = open_store(folder, "none")
        if stored.manifest.digest == digest:
            return figures_of(stored.table), stored.recipe.spec
    return None, None
