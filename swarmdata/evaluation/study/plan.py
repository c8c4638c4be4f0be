"""The plan of a study: which algorithms are compared on which datasets, and how."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, field_validator, model_validator

from swarmdata.numerics.random import SeedBlock
from swarmdata.specs.frozen import Frozen, Positive, is_file
from swarmdata.specs.plain_names import Text, repeated

MOST_SEEDS = 1_000

MOST_SHIFTED_EPISODES = 200  # in other conditions, unless a plan says otherwise or has fewer

Label = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]*$", max_length=48)]
Count = Annotated[int, Field(ge=1, le=10**12)]
Points = Annotated[int, Field(ge=1, le=1_000)]
Episodes = Annotated[int, Field(ge=1, le=1_000_000)]
Width = Annotated[int, Field(ge=1, le=65_536)]
Names = Annotated[tuple[str, ...], Field(max_length=1_000)]
Size = Literal["full", "mini"] | Annotated[int, Field(ge=1)]  # or joint steps from the start
Parts = Annotated[dict[str, Positive], Field(min_length=2, max_length=100)]  # weights of datasets


def _first_seeds(value: Any) -> Any:
    is_number = isinstance(value, int) and not isinstance(value, bool)
    if is_number and not 1 <= value <= MOST_SEEDS:
        raise ValueError(f"{value} seeds, expected from 1 to {MOST_SEEDS}, or a list of seeds")
    return tuple(range(value)) if is_number else value


def _different(seeds: tuple[int, ...]) -> tuple[int, ...]:
    if len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds {seeds} repeat, expected different ones")
    return seeds


Seeds = Annotated[
    tuple[Annotated[int, Field(ge=0, lt=1 << 32)], ...],
    Field(min_length=1, max_length=MOST_SEEDS),
    BeforeValidator(_first_seeds),
    AfterValidator(_different),
]


class Variant(Frozen):
    """One algorithm with its settings: a row of the tables."""

    algorithm: str  # registered offline
    family: Text  # such as "value decomposition"; the best of each is swept; the label by default
    settings: dict[str, Any] = Field(default_factory=dict)  # by the names of its Config
    updates: Count | None = None  # None: the algorithm's default times the study's budget
    frame: str = "auto"  # of observations and actions, as `swarmdata train --frame`
    rewards: dict[str, float] | str | None = None  # to learn from, as `load` takes them
    seeds: Seeds | None = None  # of its trainings; None: the study's
    datasets: Names = ()  # of the study; empty: all

    @model_validator(mode="after")
    def _has_one_length(self) -> Self:
        if self.updates is not None:
            _check_one_length("updates", "n_updates", self.settings)
        return self


class Baseline(Frozen):
    """An online algorithm: a finished run, or an algorithm and a task to train in."""

    run: str | None = None  # run folder, relative to the working directory
    algorithm: str | None = None  # registered online
    task: str | None = None  # preset or spec's file
    frames: Count | None = None  # joint steps of each seed; None: the algorithm's default
    start: str | None = None  # offline run that training begins with, as `train_online` takes it
    settings: dict[str, Any] = Field(default_factory=dict)  # by the names of its Config

    @model_validator(mode="after")
    def _one_or_the_other(self) -> Self:
        trains = self.algorithm is not None and self.task is not None
        if (self.run is None) != trains or (
            self.run and (self.frames or self.start or self.settings)
        ):
            raise ValueError("expected either `run`, or `algorithm` and `task` with their settings")
        if self.frames is not None:
            _check_one_length("frames", "n_steps", self.settings)
        return self


class CurvesPlan(Frozen):
    """Learning curves: how often policies are evaluated, and on how many validation seeds."""

    points: Points = 10  # evaluations in a training
    episodes: Episodes = 64  # validation seeds of each
    datasets: Names = ()  # of the study; empty: all


class SizesPlan(Frozen):
    """Data efficiency: the same algorithms on smaller parts of the same data."""

    datasets: Names  # of the study
    algorithms: Names  # labels
    sizes: Annotated[tuple[Size, ...], Field(min_length=2)] = ("full", 200_000, "mini")
    """Parts of the data."""


def _model_name(value: str) -> str:
    if is_file(value) or "/" in value:
        raise ValueError(f"got {value!r:.100}, expected the name of a model, such as lossy-30")
    return value


ModelName = Annotated[str, AfterValidator(_model_name)]
"""Of an observation or a communication model; it is a part of cells' names."""


class View(Frozen):
    """What robots sense and hear; None: as recorded."""

    observation: ModelName | None = None  # name of the observation model
    communication: ModelName | None = None  # name of the communication model

    @property
    def models(self) -> tuple[str | None, str | None]:
        """Of sensors and of the radio."""
        return self.observation, self.communication


class ViewsPlan(Frozen):
    """Information: the same data seen and heard in other ways, for training and evaluation.

    Policies that `transfer` names are also evaluated in the other views that give the same inputs.
    Rows that `online` names learn in their task with the sensors and the radio of each view.
    """

    datasets: Names  # of the study
    algorithms: Names  # labels
    views: Annotated[dict[Label, View], Field(min_length=1)]  # by label
    transfer: Names = ()  # labels
    transfer_episodes: Episodes | None = None  # of each pair; None: at most 200 of the study's
    online: Names = ()  # labels of online rows


class TasksPlan(Frozen):
    """Place and size: finished rows are also evaluated in other tasks, without training there."""

    datasets: Names  # of the study
    algorithms: Names  # labels
    tasks: Annotated[Names, Field(min_length=1)]  # presets or specs' files
    episodes: Episodes | None = None  # seeds in each task; None: at most 200 of the study's

    @field_validator("tasks")
    @classmethod
    def _names_differ(cls, tasks: Names) -> Names:
        if twice := repeated(Path(task).stem for task in tasks):
            raise ValueError(f"several tasks are called {', '.join(twice)}, expected one of each")
        return tasks


class SweepPlan(Frozen):
    """Robustness: the best variant of each family under worse communication or sensing.

    Variants are trained on the dataset, re-observed with these models, and evaluated along one axis
    with everything else fixed.
    """

    dataset: str  # of the study; its results decide which variants are best
    communication: ModelName | None = None  # trained with; None: as recorded
    observation: ModelName | None = None  # trained with; None: as recorded
    vary: Literal["communication", "observation"]  # which of the two gets worse
    axis: str  # in the syntax of `swarmdata sweep`, such as drop=0..0.8
    points: Points = 5  # values along the axis
    episodes: Episodes | None = None  # seeds of each value; None: at most 200 of the study's
    families: Names = ()  # empty: all offline ones


class LossesPlan(Frozen):
    """A figure of a quantity that training logs, such as Q-values."""

    column: str  # of the runs' losses.csv
    label: Text  # of the axis
    datasets: Names  # of the study
    algorithms: Names  # labels


class DifferencesPlan(Frozen):
    """Rows to compare in pairs, by episode: the first of a pair minus the second."""

    title: Text  # of the section
    pairs: Annotated[tuple[tuple[str, str], ...], Field(min_length=1, max_length=1_000)]  # labels
    doubling: bool = False  # the first is the second with twice the updates


def _by_label(value: Any) -> Any:
    """A list of registered algorithms becomes rows of these names, each with its defaults.

    A row without `algorithm` is of the algorithm of its label, and one without `family` is a family
    of its own.
    """
    if isinstance(value, list | tuple):
        if twice := repeated(map(str, value)):
            raise ValueError(f"algorithms are named twice: {', '.join(twice)}")
        value = {str(name): {} for name in value}
    if not isinstance(value, Mapping):
        return value
    return {
        label: {"algorithm": label, "family": label, **row} if isinstance(row, Mapping) else row
        for label, row in value.items()
    }


class Study(Frozen):
    """The grid of a study, its protocol and its budget."""

    name: Label  # of its output folder, unless `--out` says otherwise
    title: Text = ""  # of the report
    datasets: Annotated[Names, Field(min_length=1)]  # ids, folders or names of mixtures
    mixtures: dict[Label, Parts] = Field(default_factory=dict)
    """Datasets that rows of batches are drawn from in proportion to weights, by name."""
    core: Names = ()  # of the datasets: rows that are on all of these are also compared apart
    algorithms: Annotated[dict[Label, Variant], Field(min_length=1), BeforeValidator(_by_label)]
    """Rows of the tables, by label."""
    seeds: Seeds = (0, 1, 2, 3, 4)  # of trainings; a number n means 0 to n - 1
    budget: Positive = 1.0  # times each algorithm's default number of updates
    hidden: Annotated[tuple[Width, ...], Field(min_length=1)] | None = None  # of actors and critics
    settings: dict[str, Any] = Field(default_factory=dict)  # for every algorithm that has them
    episodes: Episodes = 500  # seeds of the block, from the first
    block: SeedBlock = "evaluation"  # `validation` for studies in which settings are chosen
    curves: CurvesPlan | None = None  # learning curves; None: none
    online: dict[Label, Baseline] = Field(default_factory=dict)  # online rows, by label
    sizes: SizesPlan | None = None  # data efficiency; None: none
    information: ViewsPlan | None = None  # other sensors and radios; None: none
    tasks: TasksPlan | None = None  # other tasks; None: none
    sweeps: dict[Label, SweepPlan] = Field(default_factory=dict)  # robustness, by name
    sides: dict[Label, Text] = Field(default_factory=dict)
    """Sides that learn from their own rows -> who plays the others in evaluations."""
    losses: dict[Label, LossesPlan] = Field(default_factory=dict)  # by the figure's name
    differences: dict[Label, DifferencesPlan] = Field(default_factory=dict)
    """Pairs of rows, by name."""
    device: str = "cpu"  # torch device

    @model_validator(mode="after")
    def _names_are_known(self) -> Self:
        if twice := sorted(self.algorithms.keys() & self.online.keys()):
            raise ValueError(
                f"{twice} are labels of both offline and online algorithms; rename one of each pair"
            )
        views = self.information
        parts: list[tuple[str, Names, Names]] = [
            (where, part.datasets, part.algorithms)
            for where, part in {"sizes": self.sizes, "information": views, "tasks": self.tasks,
                                **{f"losses.{k}": v for k, v in self.losses.items()}}.items()
            if part is not None
        ]  # fmt: skip
        parts += [(f"sweeps.{k}", (v.dataset,), ()) for k, v in self.sweeps.items()]
        parts += [("curves", self.curves.datasets, ())] if self.curves else []
        parts += [("core", self.core, ())]
        parts += [(f"algorithms.{k}", v.datasets, ()) for k, v in self.algorithms.items()]
        for where, datasets, labels in parts:
            _check_known(f"{where}.datasets", datasets, self.datasets)
            _check_known(f"{where}.algorithms", labels, self.algorithms)
        for label, sweep in self.sweeps.items():
            _check_known(f"sweeps.{label}.families", sweep.families, self.families)
        if views:
            _check_known("information.transfer", views.transfer, views.algorithms)
            _check_known("information.online", views.online, self.online)
            for label in views.online:
                if self.online[label].run is not None:
                    raise ValueError(
                        f"information.online has {label}, a finished run, which learned in one "
                        "view; expected rows that the study trains"
                    )
        return self

    @model_validator(mode="after")
    def _has_one_length(self) -> Self:
        if self.budget != 1:
            _check_one_length("budget", "n_updates", self.settings)
        return self

    @model_validator(mode="after")
    def _core_has_rows(self) -> Self:
        rows = [label for label in self.algorithms if all(self.has(label, d) for d in self.core)]
        if self.core and (len(self.core) < 2 or len(rows) < 2):
            raise ValueError(
                "core needs at least two datasets, and two rows that are on all of them; got "
                f"{len(self.core)} and {len(rows)}"
            )
        return self

    @model_validator(mode="after")
    def _mixtures_are_trained_on_as_they_are(self) -> Self:
        _check_known("mixtures", self.mixtures, self.datasets)
        for name in self.mixtures:
            if self.sizes and name in self.sizes.datasets:
                raise ValueError(f"sizes.datasets has the mixture {name}, expected single datasets")
            for label, row in self.algorithms.items():
                if row.rewards and self.has(label, name):
                    raise ValueError(
                        f"{label} has rewards and learns from the mixture {name}, which a study "
                        "mixes with the recorded rewards only; name the datasets of that row"
                    )
        return self

    @model_validator(mode="after")
    def _sides_learn_on_the_grid_alone(self) -> Self:
        others = ("core", "mixtures", "curves", "online", "sizes", "information", "tasks", "sweeps")
        if self.sides and (found := [name for name in others if getattr(self, name)]):
            raise ValueError(
                f"sides cannot be combined with {', '.join(found)}; give those a study of their own"
            )
        return self

    @model_validator(mode="after")
    def _views_differ(self) -> Self:
        seen: dict[tuple[str | None, str | None], str] = {}
        views = self.information.views if self.information else {}
        for label, view in views.items():
            if (same := seen.setdefault(view.models, label)) != label:
                raise ValueError(
                    f"information.views: {label} has the models of {same}; leave one of them out"
                )
        return self

    @model_validator(mode="after")
    def _pairs_are_of_different_rows(self) -> Self:
        for name, plan in self.differences.items():
            for one, other in plan.pairs:
                where = f"differences.{name}"
                _check_known(where, (one, other), self.algorithms)
                if one == other:
                    raise ValueError(f"{where} compares {one!r} with itself, expected another row")
                if plan.doubling:
                    self._check_doubling(where, one, other)
        return self

    def _check_doubling(self, where: str, one: str, other: str) -> None:
        longer, shorter = self.algorithms[one], self.algorithms[other]
        expected = shorter.updates and 2 * shorter.updates
        doubled = {"updates": expected, "datasets": longer.datasets, "family": longer.family}
        if expected is None or longer != shorter.model_copy(update=doubled):
            raise ValueError(
                f"{where}: {one!r} is not {other!r} with twice the updates, which doubling: true "
                "promises; state updates of both, and leave the rest of the rows equal"
            )

    def shifted_episodes(self, asked: int | None) -> int:
        """Seeds in each other condition of the plan: as asked for, or the study's, at most 200."""
        return min(self.episodes, MOST_SHIFTED_EPISODES) if asked is None else asked

    def has(self, label: str, dataset: str) -> bool:
        """Whether a row is trained on a dataset of the study."""
        return dataset in (self.algorithms[label].datasets or self.datasets)

    @property
    def families(self) -> Names:
        """The families of the offline algorithms, in the order of the file."""
        return tuple(dict.fromkeys(variant.family for variant in self.algorithms.values()))


def _check_one_length(key: str, name: str, settings: Mapping[str, Any]) -> None:
    if name in settings:
        raise ValueError(f"got {key} and the setting {name}, expected one of them: leave one out")


def _check_known(where: str, names: Iterable[str], known: Iterable[str]) -> None:
    for name in names:
        if name not in known:
            raise ValueError(f"{where} has {name!r}, which the study lacks: {', '.join(known)}")
