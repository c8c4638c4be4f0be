"""Finds the policies that a name on the command line means."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from swarmdata.errors import SpecError, SwarmdataError, UnknownNameError
from swarmdata.evaluation.runs.named_policies import find_opponents, open_run, tier_of_side
from swarmdata.evaluation.runs.provenance import Provenance, code_version
from swarmdata.hub.catalog.catalog import find_folder
from swarmdata.interfaces import Policy
from swarmdata.learn.deployment.onnx_policy import OnnxPolicy
from swarmdata.learn.training.run_files import find_run
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import (
    CHECKPOINT_POLICIES,
    POLICIES,
    checkpoint_free_policies,
    make_policy,
    make_task,
)
from swarmdata.registry.presets import find_spec
from swarmdata.registry.recipes import find_recipe, is_dataset, shipped_recipes, sources
from swarmdata.registry.tiers import TIERS, TRAINED_TIERS
from swarmdata.rollouts.recipe_episodes import make_source_policy
from swarmdata.rollouts.side_policy import play_sides
from swarmdata.runtime.outside_names import is_folder, looks_like_path
from swarmdata.runtime.own_components import code_of, defined_elsewhere
from swarmdata.specs.model_choice import Ranges, Source, check_senses, chosen_models, with_models
from swarmdata.specs.origins import Origin, SideSpec, task_of
from swarmdata.specs.recipe import PolicySource, who_acts
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import open_store
from swarmdata.store.recognition import is_dataset as is_dataset_folder

ONNX_SUFFIX = ".onnx"  # of files with a policy
DEFAULT_TASK = "coop_nav"  # preset in which policies and tiers act unless another is named

if TYPE_CHECKING:
    from swarmdata.evaluation.runs.trained_policies import Trained


@dataclass(frozen=True, eq=False)
class Target:
    """A named team: one policy, or one for each training seed or checkpoint."""

    spec: TaskSpec
    policies: tuple[Policy, ...]
    provenances: tuple[Provenance, ...]  # one per policy, all with the same label
    side: SideSpec | None = None  # the side that is measured; its policies play all sides

    @property
    def measured(self) -> TaskSpec | SideSpec:
        """What results are of: the spec, or one side with its opponents."""
        return self.spec if self.side is None else self.side

    @property
    def label(self) -> str:
        """The name of its row in tables."""
        return self.provenances[0].label

    def labelled(self, label: str) -> "Target":
        """Returns the same team under another label."""
        named = (each.model_dump() | {"label": label} for each in self.provenances)
        parsed = tuple(Provenance.parse(each, f"label {label!r}") for each in named)
        return replace(self, provenances=parsed)


Choose = Callable[..., TaskSpec]
"""`chosen_models` with the models, simulator and ranges to evaluate with."""


def _evaluation_spec(policy: str, trained: TaskSpec, choose: Choose, *, is_fixed: bool) -> TaskSpec:
    """The spec of the training with the models asked for; a fixed policy needs its features."""
    spec = choose(trained)
    if is_fixed and spec != trained:
        features = (features_of(make_task(each)) for each in (trained, spec))
        check_senses(policy, trained, spec, *features)
    return spec


def find_target(
    name: str,
    task: str | None = None,
    observation: Source | None = None,
    communication: Source | None = None,
    backend: str | None = None,
    randomization: Ranges | None = None,
    *,
    side: str | None = None,
    opponents: str | None = None,
) -> Target:
    """Finds the team that a name means.

    Args:
        name: a registered policy such as `random`; a learned tier such as `expert`: its checkpoints
            without noise; a dataset, by its id or by its folder: its behavior policies as recorded;
            a training run, by its folder or as `zoo:ALGORITHM/DATASET`: its newest policies, one
            per seed; or a file of ONNX. In a task of several sides, the teams of a tier or dataset
            that share no trained policy play.
        task: where policies, tiers and runs act: a preset's name, or a spec file. None: runs where
            they were trained, the others in `DEFAULT_TASK`. Datasets' policies act in their task.
        observation: observation model, such as `lidar`; None: that of the task, the dataset or the
            training.
        communication: communication model, such as `lossy-30`, likewise.
        backend: simulator, such as `mujoco`, likewise.
        randomization: ranges from which episodes draw, such as {"mass": (1, 2)}, likewise.
        side: the side that a registered policy or a tier plays, in a task of several; runs that
            were trained for a side play that.
        opponents: who plays the other sides: a registered policy; a tier, or a run that was trained
            for another side, whose first policy plays.

    Raises:
        UnknownNameError: nothing has that name, or there is no such simulator.
        PolicyFitError: the task or the models do not provide what a trained policy needs.
        SpecError: the run was trained on a recording of another environment; a task is given with
            a dataset; or the dataset's policies were not recorded with it.
        MissingExtraError: a run folder needs torch, or a file of ONNX onnxruntime.
        CheckpointError: a file of ONNX does not fit the task.
    """
    choose = partial(
        chosen_models, observation=observation, communication=communication, backend=backend,
        randomization=randomization,
    )  # fmt: skip
    found = _find(name, task, choose, side, opponents)
    version = code_version(tasks=found.spec.task)
    dated = (each.model_copy(update={"code_version": version}) for each in found.provenances)
    return replace(found, provenances=tuple(dated))


def _find(
    name: str, task: str | None, choose: Choose, side: str | None, opponents: str | None
) -> Target:
    """Finds a target as `find_target` does, which then dates it."""
    if (run := find_run(name)) is not None:
        return _run_target(open_run(run), side, opponents, task, choose)
    if (data := find_dataset(name)) is not None:
        _refuse_sides(name, side, opponents)
        check_no_task(name, task)
        if isinstance(data, Path):
            return _own_target(data, choose)
        return _recorded_target(name, find_recipe(name), choose)
    task = DEFAULT_TASK if task is None else task
    if name.endswith(ONNX_SUFFIX) and Path(name).is_file():
        _refuse_sides(name, side, opponents)
        spec = _evaluation_spec(name, find_spec(task), choose, is_fixed=True)
        return onnx_target([Path(name)], spec, Path(name).stem)
    if name in checkpoint_free_policies():
        spec = _evaluation_spec(name, find_spec(task), choose, is_fixed=False)
        return _registered_target(name, spec, side, opponents)
    if name in TRAINED_TIERS and (found := sources(task, name, 0.0)):
        spec = _evaluation_spec(name, find_spec(task), choose, is_fixed=True)
        return _tier_target(name, found, spec, side, opponents)
    raise _unknown(name, task)


def onnx_target(files: Sequence[Path], spec: TaskSpec, label: str) -> Target:
    """Returns the team of each file of ONNX, as one row; raises as `OnnxPolicy` does."""
    contents = [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
    policies = tuple(OnnxPolicy(file, spec) for file in files)
    paths = [{"run": str(file.resolve())} for file in files]  # tell files of one name apart
    pairs = zip(_numbered(label, contents), paths, strict=True)
    return Target(spec, policies, tuple(each.model_copy(update=path) for each, path in pairs))


def find_dataset(name: str) -> str | Path | None:
    """The id of a dataset of the package, or the folder of another: cached, or a path."""
    if is_dataset(name):
        return name
    if name in POLICIES or name in TIERS:
        return None
    if is_folder(name):
        return Path(name) if is_dataset_folder(Path(name)) else None
    if looks_like_path(name):
        return None
    try:
        return find_folder(name)
    except UnknownNameError:
        return None


def check_no_task(dataset: str, task: str | None) -> None:
    """Refuses a task for a dataset's policies, which would not act in it."""
    if task is not None:
        raise SpecError(
            f"{dataset} is a dataset, whose policies act in its own task, not in {task}; leave the "
            "task (--task) out, or name policies, tiers or runs"
        )


def _numbered(label: str, contents: Sequence[str | None]) -> tuple[Provenance, ...]:
    where = f"the policies of {label!r}, whose name is their label; rename the file"
    return tuple(
        Provenance.parse({"label": label, "index": index, "content": content}, where)
        for index, content in enumerate(contents)
    )


def _unknown(name: str, task: str) -> SwarmdataError:
    """What is wrong with a name that means nothing."""
    if looks_like_path(name):
        if is_folder(name):
            return SpecError(f"{name} holds neither a training run nor a dataset")
        return SpecError(
            f"there is no folder at {name}, expected that of a training run or a dataset, or an "
            "ONNX file. Check the path, or make a run with `swarmdata train ... --out FOLDER`."
        )
    trained = {tier for tier in TRAINED_TIERS if sources(task, tier)}
    known = checkpoint_free_policies() | trained | {*shipped_recipes()}
    return UnknownNameError("policy, tier, dataset or run folder", name, known)


def _own_target(folder: Path, choose: Choose) -> Target:
    """The behavior policies of a dataset of one's own, whose networks are in its folder."""
    stored = open_store(folder, "none")
    origin, packages = stored.recipe, stored.manifest.provenance
    task_of(origin, "acting again")
    unknown = [source for source in who_acts(origin.policies) if source.name not in POLICIES]
    if unknown and origin.recipe is not None:
        name = unknown[0].name
        missing = defined_elsewhere("policy", name, packages.get(f"policy {name}", ""))
        raise SpecError(f"{origin.id}: acting again needs {missing}.")
    if unknown:
        labels = ", ".join(source.label for source in unknown)
        raise SpecError(
            f"{origin.id} was recorded without its policies {labels}, which therefore "
            "cannot act again; `swarmdata render` draws its episodes, and a report has their mean."
        )
    return _recorded_target(origin.id, origin, choose, folder)


def _recorded_target(
    name: str, origin: Origin, choose: Choose, folder: Path | None = None
) -> Target:
    is_fixed = any(source.name in CHECKPOINT_POLICIES for source in who_acts(origin.policies))
    spec = _evaluation_spec(name, task_of(origin, "acting again"), choose, is_fixed=is_fixed)
    teams = _independent(origin.policies)
    policies = tuple(make_source_policy(source, spec, folder) for source in teams)
    return Target(spec, policies, _numbered(name, [_recorded(origin, each) for each in teams]))


def _recorded(origin: Origin, team: PolicySource) -> str:
    """The hash of a recipe, and of the code of users' policies in a team."""
    codes = [code for each in team.acting if (code := code_of("policies", each.name))]
    if not codes:
        return origin.hash()
    return hashlib.sha256("".join([origin.hash(), *codes]).encode()).hexdigest()


def _side_run_target(
    found: "Trained",
    trained: SideSpec,
    side: str | None,
    opponents: str | None,
    task: str | None,
    choose: Choose,
) -> Target:
    """The policies of a run that was trained for a side, each against the opponents."""
    folder = found.folder
    if side not in (None, trained.side):
        raise SpecError(f"{folder} was trained for the side {trained.side}, got side {side!r}")
    if opponents is None:
        raise SpecError(
            f"{folder} was trained for the side {trained.side} of {trained.whole.task}, and needs "
            f"opponents, which only evaluate gives it: swarmdata evaluate {folder} --opponents "
            "scripted, or a run of another side"
        )
    if task is not None and find_spec(task).rules != trained.whole.rules:
        raise SpecError(
            f"{folder} was trained for one side, which plays in the task of its training, not in "
            f"{task}; leave the task (--task) out"
        )
    spec = _evaluation_spec(str(folder), trained.whole, choose, is_fixed=True)
    return _on_side(spec, trained.side, opponents, found.policies(), found.provenances)


def _registered_target(
    name: str, spec: TaskSpec, side: str | None, opponents: str | None
) -> Target:
    """A registered policy, of the whole team or on one side."""
    provenances = (Provenance(label=name, content=code_of("policies", name)),)
    if side is None and opponents is None:
        return Target(spec, (make_policy(name, spec),), provenances)
    seat = _seat(name, spec, side, opponents)
    return _on_side(spec, *seat, (name,), provenances)


def _tier_target(
    name: str,
    teams: Sequence[PolicySource],
    spec: TaskSpec,
    side: str | None,
    opponents: str | None,
) -> Target:
    """The teams of a tier; or its policies that play a side, each against the opponents."""
    if side is None and opponents is None:
        apart = _independent(teams)
        policies = tuple(make_source_policy(each, spec) for each in apart)
        return Target(spec, policies, _numbered(name, [_content(each) for each in apart]))
    side, opponents = _seat(name, spec, side, opponents)
    found = tier_of_side(name, side, spec)
    players = [make_source_policy(each, SideSpec(whole=spec, side=side)) for each in found]
    provenances = _numbered(name, [each.sha256 for each in found])
    return _on_side(spec, side, opponents, players, provenances)


def _independent(teams: Sequence[PolicySource]) -> tuple[PolicySource, ...]:
    """Leaves out teams of several sides that share a trained policy with an earlier team.

    Intervals for new training seeds take teams for independent runs, which they are not where every
    policy of one side plays every policy of another.
    """
    kept, known = [], set[str]()
    for team in teams:
        trained = {each.sha256 for each in team.acting if each.sha256} if team.opponents else set()
        if not trained & known:
            kept.append(team)
            known |= trained
    return tuple(kept)


def _content(team: PolicySource) -> str | None:
    """The digest of a checkpoint, or of those of all sides."""
    if not team.opponents:
        return team.sha256
    return hashlib.sha256("".join(str(each.sha256) for each in team.acting).encode()).hexdigest()


def _seat(name: str, spec: TaskSpec, side: str | None, opponents: str | None) -> tuple[str, str]:
    """The side that a policy plays, and who plays the others; SpecError without one of them."""
    if side is None or opponents is None:
        raise SpecError(
            f"got side (--side) {side!r} and opponents (--opponents) {opponents!r} for {name}, "
            "expected both: it plays one side, and they the others"
        )
    spec.side(side)
    return side, opponents


def _on_side(
    spec: TaskSpec,
    side: str,
    opponents: str,
    policies: Sequence[Policy | str],
    provenances: tuple[Provenance, ...],
) -> Target:
    """Policies that play one side, each against the opponents."""
    who, label = find_opponents(opponents, side, spec)
    teams = tuple(play_sides(spec, side, each, who) for each in policies)
    return Target(spec, teams, provenances, SideSpec(whole=spec, side=side, opponents=label))


def _refuse_sides(name: str, side: str | None, opponents: str | None) -> None:
    """Refuses sides for what plays all of them."""
    given = {"side": side, "opponents": opponents}
    if named := [f"{each} (--{each})" for each, value in given.items() if value is not None]:
        raise SpecError(
            f"{name} is of a whole team and does not take {' and '.join(named)}; registered "
            "policies and runs that were trained for a side do"
        )


def _run_target(
    found: "Trained",
    side: str | None,
    opponents: str | None,
    task: str | None,
    choose: Choose,
) -> Target:
    folder = found.folder
    if found.side is not None:
        return _side_run_target(found, found.side, side, opponents, task, choose)
    _refuse_sides(str(folder), side, opponents)
    advice = (
        "Evaluate it with swarmdata.evaluate_parallel and the environment, or compare runs by the "
        "data alone with `swarmdata rank`."
    )
    world = trained = found.task(advice)
    if task is not None:
        world = with_models(find_spec(task), trained.observation, trained.communication)
    spec = choose(world, own=TaskSpec.parse(found.own_spec, str(folder)))
    return Target(spec, found.fitted(spec, advice), found.provenances)
