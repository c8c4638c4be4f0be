"""Cells of a study: one algorithm on one dataset with all seeds, each in a folder of its own."""

import dataclasses
import hashlib
import itertools
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field

from swarmdata import __version__
from swarmdata.errors import SpecError
from swarmdata.evaluation.runs.named_policies import opponents_hash
from swarmdata.evaluation.runs.portable_names import without_places
from swarmdata.evaluation.runs.provenance import code_version
from swarmdata.evaluation.study.cells.study_data import (
    changed_rewards,
    dataset_of_size,
    joint_digest,
    recorded_task,
    short_count,
    short_name,
    task_name,
)
from swarmdata.evaluation.study.plan import Study, Variant, View
from swarmdata.learn.training.run_files import CONFIG, last_policy_path, run_folders, seeds_of
from swarmdata.learn.training.settings import as_texts, check_effects, override, unmet_needs
from swarmdata.numerics.random import SeedBlock
from swarmdata.online_algos.continuation.offline_start import begin_with
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import (
    OFFLINE_ALGORITHMS,
    ONLINE_ALGORITHMS,
    make_task,
    resolve,
)
from swarmdata.registry.presets import find_spec, preset_names
from swarmdata.specs.frozen import Frozen, describe_differences
from swarmdata.specs.model_choice import with_models

CELL_FILE = "cell.json"  # the cell, written first; a folder of another cell is refused
DATA_FILE = "data.json"  # what the episodes of its dataset achieved
RESULTS_FOLDER = "results"  # one file per seed
COST_FILE = "cost.json"  # time, memory, speed
ERROR_FILE = "error.txt"  # the traceback, if the cell failed
DONE_FILE = "done.json"  # written last: the cell's key, and the digests of its results

ONLINE_FAMILY = "online"

FIELDS_OUTSIDE_KEY = {"family", "source", "parts", "run", "start"}
"""Fields that affect no result, or paths of files that `digest` and `start_hash` cover."""

YOUNGER_FIELDS = ("rewards", "side", "opponents", "opponents_hash", "start_hash")
"""Than cells without them."""

YOUNGER_SETTINGS: dict[str, Any] = {"reward_weights": [], "independent": False}
"""Younger than studies; change nothing."""

AS_RECORDED = View()  # models of the dataset itself

WIDTHS = ("hidden", "actor_hidden", "critic_hidden")
"""Settings that a study's `hidden` sets; flows, which only teach these networks, have their own."""


class Cell(Frozen):
    """Everything that determines the results of one cell."""

    kind: Literal["offline", "online", "run"]  # on a dataset, in a task, or of a finished run
    label: str  # of the algorithm, in the study
    data: str  # short name of the dataset, or of the task
    family: str
    algorithm: str
    config: dict[str, Any]  # with all defaults; empty for a finished run, which `digest` covers
    source: str = ""  # dataset to load, name of a mixture, or task to train in
    parts: dict[str, float] = Field(default_factory=dict)  # of a mixture: weights of datasets
    run: str = ""  # folder of a finished run
    start: str = ""  # offline run that online training begins with
    start_hash: str | None = None  # of the files of that run
    digest: str  # of the dataset, of parts with weights, of a run, or of a task in a file
    n_steps: int | None = None  # uses only the first episodes of the dataset
    observation: str | None = None  # model for training and evaluation; None: as recorded
    communication: str | None = None
    frame: str = "auto"  # of offline cells
    rewards: dict[str, float] = Field(default_factory=dict)  # other weights to learn from
    side: str | None = None  # that learns, in a task of several
    opponents: str | None = None  # who plays the other sides in the evaluation
    opponents_hash: str | None = None  # of their run or own code; None: they are of the package
    seeds: tuple[int, ...]
    n_episodes: int  # of the evaluation; 0: none, as where the data have no simulator
    block: SeedBlock = "evaluation"
    curve_every: int | None = None  # updates between points; None: no learning curve
    curve_episodes: int = 64
    device: str = "cpu"
    code_version: str = __version__

    @property
    def name(self) -> str:
        """The name, unique in a study; also the path of the cell's folder."""
        return f"{self.label}/{self.data}"

    @property
    def key(self) -> str:
        """Hash of everything that determines the results."""
        content = without_places(self.model_dump(mode="json", exclude=FIELDS_OUTSIDE_KEY))
        for name in YOUNGER_FIELDS:
            if not content[name]:
                del content[name]
        for name, value in YOUNGER_SETTINGS.items():  # the same for cells without these settings
            if content["config"].get(name) == value:
                del content["config"][name]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @property
    def n_updates(self) -> int:
        """Length of training in the algorithm's own unit; 0 for a finished run."""
        return int(self.config.get("n_updates", self.config.get("n_steps", 0)))

    @classmethod
    def in_folder(cls, folder: Path) -> Self:
        """Reads the cell that a folder belongs to."""
        return cls.from_file(folder / CELL_FILE)

    def folder(self, work: Path) -> Path:
        """Where a study keeps the cell, below its folder of runs and results."""
        return work / "cells" / self.label / self.data

    def run_in(self, folder: Path) -> Path:
        """The run folder in the cell's folder; its name becomes the label of the policies."""
        return folder / self.label

    def is_done(self, folder: Path) -> bool:
        """Whether the folder holds the complete results of this cell."""
        file = folder / DONE_FILE
        return file.exists() and json.loads(file.read_text(encoding="utf-8"))["key"] == self.key

    def conflict(self, folder: Path) -> str | None:
        """How the folder's cell differs from this one; None if it is the same, or not there yet."""
        if not (folder / CELL_FILE).exists():
            return None
        stored = Cell.in_folder(folder)
        return None if stored.key == self.key else describe_differences(stored, self)


def cells_of(study: Study, digest_of: Callable[[str], str]) -> list[Cell]:
    """Returns the cells of a study without those of its sweeps, in the order of the plan.

    `digest_of` returns the digest of a dataset by its id or folder.

    Raises:
        UnknownNameError: no such algorithm, setting, reward weight or set of them.
    """
    _check_settings(study)
    _check_datasets(study, digest_of)
    _check_views(study)
    found = [
        offline_cell(study, label, dataset, digest_of, side=side)
        for dataset, side, label in itertools.product(
            study.datasets, study.sides or (None,), study.algorithms
        )
        if study.has(label, dataset)
    ]
    if (sizes := study.sizes) is not None:
        for dataset, size, label in itertools.product(
            sizes.datasets, sizes.sizes, sizes.algorithms
        ):
            part, n_steps = dataset_of_size(dataset, size)
            found.append(offline_cell(study, label, part, digest_of, n_steps=n_steps))
    seen = study.information
    views = () if seen is None else seen.views.values()
    if seen is not None:
        found += [
            offline_cell(study, label, dataset, digest_of, view=view)
            for dataset, view, label in itertools.product(seen.datasets, views, seen.algorithms)
            if study.has(label, dataset)
        ]
    found += [_online_cell(study, label) for label in study.online]
    if seen is not None:
        found += [_online_cell(study, k, view) for view, k in itertools.product(views, seen.online)]
    cells: dict[str, Cell] = {}
    for cell in found:
        if cells.setdefault(cell.name, cell) != cell:
            raise SpecError(
                f"two different cells are called {cell.name}; rename a dataset of the study"
            )
    return list(cells.values())


def _check_datasets(study: Study, digest_of: Callable[[str], str]) -> None:
    """Refuses two names of the same data, whose results tables could not tell apart."""
    names: dict[str, str] = {}
    for name in study.datasets:
        if same := names.get(digest := _digest(study, name, digest_of)):
            raise SpecError(
                f"datasets has {same} and {name}, which hold the same data; leave one of them out"
            )
        names[digest] = name


def _check_views(study: Study) -> None:
    """Refuses unknown models, and two views that are the same for a dataset or an online task."""
    plan = study.information
    if plan is None:
        return
    sources = {k: next(iter(study.mixtures.get(k, (k,)))) for k in plan.datasets}
    tasks = {k: recorded_task(source, "other views") for k, source in sources.items()}
    for label in plan.online:
        tasks[label] = find_spec(str(study.online[label].task))
    for name, task in tasks.items():
        labels: dict[str, str] = {}
        for label, view in plan.views.items():
            same = labels.setdefault(with_models(task, *view.models).hash(), label)
            if same != label:
                raise SpecError(
                    f"information.views: {label} is for {name} the same as {same}; leave one out"
                )


def _digest(study: Study, dataset: str, digest_of: Callable[[str], str]) -> str:
    """The digest of a dataset of the study, or of a mixture's parts with their weights."""
    parts = study.mixtures.get(dataset)
    return joint_digest(map(digest_of, parts), parts.values()) if parts else digest_of(dataset)


def _check_settings(study: Study) -> None:
    """Refuses settings for all rows that no row has, or that change nothing in any row."""
    configs = [_config_of(study, variant) for variant in study.algorithms.values()]
    known = {field.name for config in configs for field in dataclasses.fields(config)}
    if strange := sorted(study.settings.keys() - known):
        raise SpecError(
            f"settings has {', '.join(strange)}, which none of the study's algorithms has; "
            f"expected some of: {', '.join(sorted(known))}"
        )
    for name in study.settings:
        having = [config for config in configs if hasattr(config, name)]
        if all(name in unmet_needs(config) for config in having):
            check_effects(having[0], [name])


def offline_cell(
    study: Study,
    label: str,
    dataset: str,
    digest_of: Callable[[str], str],
    *,
    n_steps: int | None = None,
    view: View = AS_RECORDED,
    side: str | None = None,
) -> Cell:
    """The cell of a variant on a dataset, on its first joint steps, re-observed, or on a side."""
    variant = study.algorithms[label]
    config, curves, every = config_of(study, variant), study.curves, None
    if curves and (not curves.datasets or dataset in curves.datasets):
        every = max(1, config["n_updates"] // curves.points)
    parts = (short_name(dataset), None if n_steps is None else short_count(n_steps), side)
    return Cell(
        kind="offline",
        label=label,
        data=_seen_in("-".join(filter(None, parts)), view),
        family=variant.family,
        algorithm=variant.algorithm,
        config=config,
        source=dataset,
        parts=study.mixtures.get(dataset, {}),
        digest=_digest(study, dataset, digest_of),
        n_steps=n_steps,
        observation=view.observation,
        communication=view.communication,
        frame=variant.frame,
        rewards={} if variant.rewards is None else changed_rewards(dataset, variant.rewards),
        side=side,
        **_opponents(study, side),
        seeds=variant.seeds or study.seeds,
        n_episodes=study.episodes,
        block=study.block,
        code_version=code_version(algorithms=variant.algorithm, tasks=_task(study, dataset)),
        curve_every=every,
        curve_episodes=curves.episodes if curves else 64,
        device=study.device,
    )


def _opponents(study: Study, side: str | None) -> dict[str, Any]:
    """Who plays the other sides, and what their name does not say."""
    name = None if side is None else study.sides[side]
    return {"opponents": name, "opponents_hash": None if name is None else opponents_hash(name)}


def _task(study: Study, dataset: str) -> str:
    return task_name(next(iter(study.mixtures.get(dataset, (dataset,)))))


def config_of(study: Study, variant: Variant) -> dict[str, Any]:
    """The complete configuration of a variant as JSON values, as in `config.json` of its runs."""
    return _json(_config_of(study, variant))


def _config_of(study: Study, variant: Variant) -> Any:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, variant.algorithm)
    config = kind.Config()
    changes: dict[str, Any] = {"n_updates": max(1, round(config.n_updates * study.budget))}
    if study.hidden is not None:
        widths = (name for name in WIDTHS if isinstance(getattr(config, name, None), tuple))
        changes |= dict.fromkeys(widths, study.hidden)
    names = {field.name for field in dataclasses.fields(config)}
    changes |= {k: v for k, v in study.settings.items() if k in names}
    changes |= {} if variant.updates is None else {"n_updates": variant.updates}
    return _changed(config, {**changes, **variant.settings}, own=variant.settings)


def _changed(config: Any, changes: Mapping[str, Any], own: Mapping[str, Any]) -> Any:
    """A changed config; refuses a row's own settings that have no effect, as `train` does."""
    found = override(config, as_texts(changes))
    check_effects(found, as_texts(own))
    return found


def _seen_in(data: str, view: View) -> str:
    return "~".join((data, *(model for model in view.models if model is not None)))


def _online_cell(study: Study, label: str, view: View = AS_RECORDED) -> Cell:
    baseline = study.online[label]
    shared: dict[str, Any] = {
        "label": label,
        "family": ONLINE_FAMILY,
        "n_episodes": study.episodes,
        "block": study.block,
    }
    if baseline.run is not None:
        return _run_cell(Path(baseline.run), shared)
    assert baseline.algorithm is not None  # checked by Baseline
    assert baseline.task is not None
    kind = resolve("algorithm", ONLINE_ALGORITHMS, baseline.algorithm)
    length = {} if baseline.frames is None else {"n_steps": baseline.frames}
    settings, task = baseline.settings, find_spec(baseline.task)
    content, taken = None, dict[str, str]()
    if baseline.start is not None:
        spec = with_models(task, *view.models)
        begin, taken = begin_with(baseline.start, kind, spec, features_of(make_task(spec)))
        content = begin.source.content
    config = _json(_changed(kind.Config(), {**taken, **length, **settings}, own=settings))
    return Cell(
        kind="online",
        data=_seen_in(Path(baseline.task).stem, view),
        algorithm=baseline.algorithm,
        config=config,
        source=baseline.task,
        digest="" if baseline.task in preset_names() else task.hash(),
        start=baseline.start or "",
        start_hash=content,
        observation=view.observation,
        communication=view.communication,
        code_version=code_version(online_algorithms=baseline.algorithm, tasks=task.task),
        seeds=study.seeds,
        **shared,
    )


def _run_cell(folder: Path, shared: Mapping[str, Any]) -> Cell:
    if not run_folders(folder):
        raise SpecError(
            f"online baseline {shared['label']!r}: {folder} is not a run folder. Train it with "
            "swarmdata train-online, or set algorithm, task and frames in the study."
        )
    found = seeds_of([folder])
    document = json.loads((found[0].folder / CONFIG).read_text(encoding="utf-8"))
    content = hashlib.sha256()
    for part in run_folders(folder):
        content.update((part / CONFIG).read_bytes())
    for seed in found:
        content.update(last_policy_path(*seed).read_bytes())
    return Cell(
        kind="run",
        data=document["spec"]["rules"]["task"],
        algorithm=document["algorithm"],
        config={},
        run=str(folder),
        digest=content.hexdigest(),
        seeds=tuple(seed.seed for seed in found),
        **shared,
    )


def _json(config: Any) -> dict[str, Any]:
    values: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(config)))
    return values
