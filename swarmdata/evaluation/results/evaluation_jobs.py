"""Evaluations of named policies as jobs: each one leaves a result file, wherever it is done."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Unpack

from pydantic import BeforeValidator

from swarmdata.errors import ResultsError
from swarmdata.evaluation.results.policy_names import Target, find_target
from swarmdata.evaluation.results.result_files import Result, check_results_folder
from swarmdata.evaluation.results.target_evaluation import evaluate_target, kept_result
from swarmdata.evaluation.runs.job_options import JobOptions, do_with_bar
from swarmdata.evaluation.runs.portable_names import portable_name, portable_source
from swarmdata.evaluation.runs.provenance import Provenance, file_name
from swarmdata.numerics.random import SeedBlock, block_seeds
from swarmdata.runtime.atomic import remove_leftovers
from swarmdata.runtime.engines.jobs import Handler, Job, Report
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.plain_names import repeated
from swarmdata.specs.randomization import Randomization
from swarmdata.specs.task_spec import TaskSpec

EVALUATOR = f"{__name__}:evaluator"

Portable = Annotated[str | dict[str, Any] | None, BeforeValidator(portable_source)]
"""What `Source` takes; a path becomes absolute."""


class TargetName(Frozen):
    """What `find_target` takes to find a target, in any process; paths become absolute."""

    name: Annotated[str, BeforeValidator(portable_name)]
    task: Annotated[str | None, BeforeValidator(portable_source)] = None
    observation: Portable = None
    communication: Portable = None
    label: str | None = None  # None: the target's own
    backend: str | None = None
    randomization: Randomization | None = None
    side: str | None = None
    opponents: Annotated[str | None, BeforeValidator(portable_source)] = None

    @property
    def changes_the_world(self) -> bool:
        """Whether the target meets another world than that of its training, or of its tier."""
        return bool(
            self.model_dump(exclude={"name", "label", "side", "opponents"}, exclude_none=True)
        )

    def find(self) -> Target:
        """Returns the target; raises as `find_target` and `Target.labelled` do."""
        models = (self.observation, self.communication, self.backend, self.randomization)
        found = find_target(self.name, self.task, *models, side=self.side, opponents=self.opponents)
        return found if self.label is None else found.labelled(self.label)


class Evaluation(Frozen):
    """One policy of a target in one spec."""

    source: TargetName  # of the target
    policy: int  # its index in the target
    provenance: Provenance  # of the policy, as it was found
    spec: TaskSpec  # to evaluate it in
    side: SideSpec | None = None  # that is measured
    n_episodes: int  # number of seeds
    block: SeedBlock  # of seeds
    folder: Path  # of its result file

    @property
    def name(self) -> str:
        """For messages, such as `policy 2 of expert`."""
        return f"policy {self.policy} of {self.provenance.label}"

    def job(self, *, again: bool, n_threads: int) -> Job:
        """What makes the result; `again`: whether one that is there is replaced."""
        here = self.model_copy(update={"folder": self.folder.resolve()})
        evaluation = here.model_dump(mode="json")
        payload = {"evaluation": evaluation, "again": again, "n_threads": n_threads}
        return Job(self.name, payload)

    def result(self) -> Result | None:
        """The result, if it is there."""
        seeds = block_seeds(self.block, self.n_episodes)
        return kept_result(self.side or self.spec, self.provenance, seeds, self.folder)


def check_different(targets: Sequence[Target]) -> None:
    """Refuses policies whose results would be called the same, before any is evaluated.

    Raises:
        ResultsError: there are two of them.
    """
    names = (file_name(each, to.measured.hash()) for to in targets for each in to.provenances)
    if twice := repeated(names):
        raise ResultsError(
            f"two of the policies would have the result {twice[0]}, expected one each: name each "
            "target once, rename a folder or file, or evaluate them apart, each with a --label"
        )


def evaluations_of(
    source: TargetName,
    target: Target,
    n_episodes: int,
    folder: Path,
    *,
    spec: TaskSpec | None = None,
    block: SeedBlock = "evaluation",
) -> list[Evaluation]:
    """Returns the evaluations of all policies of a target, which its source finds.

    They are in its spec unless another is given, on the first seeds of a block.
    """
    return [
        Evaluation(
            source=source, policy=index, provenance=provenance, spec=spec or target.spec,
            side=target.side, n_episodes=n_episodes, block=block, folder=folder,
        )
        for index, provenance in enumerate(target.provenances)
    ]  # fmt: skip


def run_evaluations(
    evaluations: Sequence[Evaluation],
    *,
    again: bool = False,
    n_threads: int = 1,
    **options: Unpack[JobOptions],
) -> int:
    """Makes the results that are not there yet, or all `again`; after a kill, it resumes.

    There is at least one evaluation; `n_threads` of each process step its worlds. Returns how many
    results were there already and stay.

    Raises:
        OutputError: a folder has files and no result.
        ResultsError: a file is of another run with the same label and dataset, or a process found
            another policy than this one.
        BatchError: evaluations failed; the others are done.
        EngineError: the engine is unknown, or cannot be reached.
    """
    for folder in {each.folder for each in evaluations}:
        check_results_folder(folder)
        remove_leftovers(folder)  # of results that are there, so that nobody writes them again
    absent = [each for each in evaluations if each.result() is None]
    waiting = evaluations if again else absent
    jobs = [each.job(again=again, n_threads=n_threads) for each in waiting]
    total = sum(each.n_episodes for each in waiting)
    folder = evaluations[0].folder
    do_with_bar(jobs, EVALUATOR, "evaluations", folder, total=total, unit="episode", **options)
    return len(evaluations) - len(waiting)


def collect_evaluations(evaluations: Sequence[Evaluation]) -> list[Result]:
    """Reads the results of evaluations that are done."""
    found = [(each, each.result()) for each in evaluations]
    missing = [each for each, result in found if result is None]
    if missing:
        raise ResultsError(
            f"{len(missing)} of {len(evaluations)} evaluations are not done: there is no result of "
            f"{missing[0].name} in {missing[0].folder}. Run them, or leave out --collect."
        )
    return [result for _, result in found if result is not None]


def evaluator() -> Handler:
    """Returns what evaluates policies in a process; a target is found once."""
    targets: dict[str, Target] = {}

    def find(wanted: Evaluation) -> Target:
        source, policy, provenances = wanted.source, wanted.policy, (wanted.provenance,)
        key = source.to_json()
        known = targets.get(key)
        if known is None or known.provenances[policy : policy + 1] != provenances:
            known = targets[key] = source.find()  # a run may have been trained further
        found = known.provenances[policy : policy + 1]
        if found != provenances:
            raise ResultsError(
                f"{source.name} has another policy {policy} where it is evaluated ({found}) than "
                f"where the evaluation was asked for ({wanted.provenance}). All processes need the "
                "same version of swarmdata and the same files; start again when the run has ended."
            )
        return Target(wanted.spec, known.policies[policy : policy + 1], found, wanted.side)

    def handle(payload: dict[str, Any], report: Report) -> None:
        wanted = Evaluation.parse(payload["evaluation"])
        options = {name: payload[name] for name in ("again", "n_threads")}
        evaluate_target(
            find(wanted), wanted.n_episodes, wanted.folder, block=wanted.block, progress=False,
            report=report, **options,
        )  # fmt: skip

    return handle
