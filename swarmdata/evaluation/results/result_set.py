"""Reads folders of results into one tidy table: by dataset and label, one result per training seed.

Results that are stale, or that do not belong together, are refused with one error.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np

from swarmdata.behavior_policies.tiers import FAMILY_SPECS
from swarmdata.errors import DatasetNotFoundError, SchemaError, UnknownNameError
from swarmdata.evaluation.results.result_checks import check_results
from swarmdata.evaluation.results.result_files import Result, load_result
from swarmdata.hub.catalog.catalog import find_folder
from swarmdata.registry.published import Figures, TaskReferences, published, references_of
from swarmdata.rollouts.metrics import Reference, normalized_score
from swarmdata.specs.model_choice import is_same_world
from swarmdata.specs.origins import RecordedSpec
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import open_store
from swarmdata.store.publication import figures_of
from swarmdata.types import Double

Spec = TaskSpec | RecordedSpec


@dataclass(frozen=True, eq=False)
class Case:
    """What labels are compared on: a dataset, or a spec for policies that learned from no data."""

    dataset: str | None  # `Provenance.dataset_key`
    spec: Spec  # that all were measured in
    reference: Reference | None  # of the score, where the world has measured ones
    data: Figures | None  # of the dataset's own episodes, where they are known
    runs: Mapping[str, tuple[Result, ...]]  # label -> one per training seed, by index

    @property
    def name(self) -> str:
        """The dataset, or the task."""
        return self.dataset or self.spec.task

    @property
    def is_view(self) -> bool:
        """Whether the dataset was observed again."""
        runs = (run for label in self.trained for run in self.runs[label])
        return any(run.provenance.view is not None for run in runs)

    @property
    def trained(self) -> tuple[str, ...]:
        """Labels that learned from the dataset, baselines left out."""
        named = self.runs.items()
        return tuple(label for label, runs in named if runs[0].provenance.dataset is not None)

    @property
    def time_limit(self) -> float:
        """Seconds that an unsolved episode took.

        Raises:
            SchemaError: an environment of another library has no time.
        """
        if isinstance(self.spec, RecordedSpec):
            raise SchemaError(f"{self.name} is of another library: its steps have no duration.")
        return self.spec.horizon * self.spec.control_dt

    @property
    def data_score(self) -> float | None:
        """Score of the mean return of the dataset's episodes, action noise included."""
        if self.data is None or self.reference is None:
            return None
        return float(normalized_score(self.data.mean_return, self.reference))

    def metric(self, label: str, name: str) -> Double:
        """A metric of a label, [runs, episodes].

        Raises:
            UnknownNameError: no such label here, or the metric was not measured.
        """
        if label not in self.runs:
            raise UnknownNameError(f"label of {self.name}", label, self.runs)
        rows = [result.evaluation.metrics for result in self.runs[label]]
        known = set(rows[0]).intersection(*rows)
        if name not in known:
            raise UnknownNameError("metric", name, known)
        return np.stack([row[name] for row in rows])

    def scores(self, label: str) -> Double:
        """Scores of a label, [runs, episodes].

        Raises:
            SchemaError: the world has no measured references.
        """
        if self.reference is None:
            raise SchemaError(
                f"{self.name} has no score: no references were measured in {self.spec.task} "
                f"{self.spec.hash()[:12]}. Use the return."
            )
        return normalized_score(self.metric(label, "return"), self.reference)


@dataclass(frozen=True, eq=False)
class ResultSet:
    """Results that belong together."""

    cases: tuple[Case, ...]  # of datasets, by task, then by the mean return of their data
    baselines: tuple[Case, ...]  # of policies that learned from no data, one per spec

    @property
    def datasets(self) -> tuple[str, ...]:
        """Keys of the datasets, in order."""
        return tuple(case.name for case in self.cases)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Of what learned from data: the lowest first, by the mean of what was measured of them."""
        found: dict[str, list[float]] = {}
        for case in self.cases:
            for label in case.runs:
                is_scored = case.reference is not None
                values = case.scores(label) if is_scored else case.metric(label, "return")
                found.setdefault(label, []).append(float(values.mean()))
        return tuple(sorted(found, key=lambda label: (np.mean(found[label]), label)))

    @cached_property
    def scores(self) -> Mapping[str, Mapping[str, Double]]:
        """Label -> dataset -> scores [runs, episodes], where they were measured."""
        return MappingProxyType(
            {
                label: MappingProxyType(
                    {
                        case.name: case.scores(label)
                        for case in self.cases
                        if label in case.runs and case.reference is not None
                    }
                )
                for label in self.labels
            }
        )

    def case(self, dataset: str) -> Case:
        """What was measured on a dataset.

        Raises:
            UnknownNameError: nothing was.
        """
        found = next((case for case in self.cases if case.name == dataset), None)
        if found is None:
            raise UnknownNameError("dataset with results", dataset, self.datasets)
        return found

    def with_baselines(self, case: Case) -> Case:
        """A case with what was measured in its spec of policies that learned from no data, first.

        A team that an algorithm trained online is marked as such: the names of some algorithms are
        those of offline ones.
        """
        found = (each for each in self.baselines if each.spec.hash() == case.spec.hash())
        others = {
            f"{label} (online)" if runs[0].provenance.frames is not None else label: runs
            for each in found
            if each is not case
            for label, runs in each.runs.items()
        }
        return replace(case, runs=MappingProxyType({**others, **case.runs}))

    @property
    def results(self) -> tuple[Result, ...]:
        """All of them."""
        groups = (runs for case in (*self.cases, *self.baselines) for runs in case.runs.values())
        return tuple(result for runs in groups for result in runs)


def read_results(
    folders: Iterable[Path | str], *, data: Sequence[Path | str] = (), is_checked: bool = True
) -> ResultSet:
    """Reads every result in folders (of those inside them, none) that `evaluate` filled.

    Args:
        folders: with result files; a file is taken as well.
        data: folders of datasets that are not published and not in the cache, for their own means.
        is_checked: whether stale and mixed results are refused.

    Raises:
        DatasetNotFoundError: a folder holds no results.
        SchemaError: a file is no result.
        ResultsError: results are stale, or do not belong together.
    """
    files = [file for folder in folders for file in _files(Path(folder))]
    return gather([load_result(file) for file in files], data=data, is_checked=is_checked)


def gather(
    results: Sequence[Result], *, data: Sequence[Path | str] = (), is_checked: bool = True
) -> ResultSet:
    """Puts results together that were read or just measured; arguments and errors as `read`."""
    if is_checked:
        check_results(results)
    groups: dict[tuple[str | None, str], list[Result]] = {}
    for result in results:
        key = result.provenance.dataset_key, result.evaluation.spec_hash
        groups.setdefault(key, []).append(result)
    cases = sorted((_case(group, data) for group in groups.values()), key=_order)
    return ResultSet(
        cases=tuple(case for case in cases if case.dataset is not None),
        baselines=tuple(case for case in cases if case.dataset is None),
    )


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

    return Case(
        dataset=provenance.dataset_key,
        spec=spec,
        reference=reference_of(spec),
        data=_data_figures(provenance.dataset, provenance.digest, data),
        runs=MappingProxyType(
            {label: tuple(runs[label]) for label in sorted(runs, key=mean_return)}
        ),
    )


def _order(case: Case) -> tuple[str, int, float, str]:
    """By task and team, then by how good the data are; unknown ones last."""
    mean = case.data.mean_return if case.data is not None else float("inf")
    return case.spec.task, case.spec.n_agents, mean, case.name


def reference_of(spec: Spec) -> Reference | None:
    """The ends of the score: measured in the spec itself, else in the headline spec of its world.

    Models change neither rewards nor returns, so a policy that sees less is scored on the scale of
    the headline spec: the loss shows.
    """
    if isinstance(spec, RecordedSpec):
        return None
    worlds = [known for known in FAMILY_SPECS.values() if is_same_world(known, spec)]
    found = (references_of(each.hash()) for each in (spec, *worlds))
    known: TaskReferences | None = next((each for each in found if each is not None), None)
    if known is None or known.no_skill is None or known.expert is None:
        return None
    return Reference(known.no_skill, known.expert)


def _data_figures(
    dataset: str | None, digest: str | None, folders: Sequence[Path | str]
) -> Figures | None:
    """Figures of a dataset's own episodes: published ones, else those of its files, else None."""
    if dataset is None:
        return None
    entry = published().get(dataset)
    if entry is not None and entry.digest == digest:
        return entry
    for folder in (*map(Path, folders), *_cached(dataset)):
        stored = open_store(folder, "none")
        if stored.manifest.digest == digest:
            return figures_of(stored.table)
    return None


def _cached(dataset: str) -> list[Path]:
    """The folder of a dataset that the cache has."""
    try:
        folder = find_folder(dataset)
    except UnknownNameError:
        return []  # somebody's own dataset, which is elsewhere
    return [folder] if (folder / "manifest.json").exists() else []
