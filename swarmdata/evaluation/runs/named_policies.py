"""From a name, as `evaluate` takes it, to one policy that acts: `make_policy`."""

from pathlib import Path
from typing import Any

from swarmdata.errors import SpecError
from swarmdata.evaluation.runs.behavior_sources import of_tier
from swarmdata.hub.remotes.outside_names import is_folder
from swarmdata.interfaces import Policy
from swarmdata.learn.training.run_files import run_folders
from swarmdata.registry.components import POLICIES
from swarmdata.registry.components import make_policy as make_registered
from swarmdata.registry.presets import find_spec
from swarmdata.rollouts.recipe_episodes import make_source_policy
from swarmdata.runtime.extras import require_extra
from swarmdata.specs.task_spec import TaskSpec


def make_policy(
    name: str | Path,
    spec: TaskSpec | Path | str | None = None,
    *,
    seed: int = 0,
    **options: Any,
) -> Policy:
    """Builds the policy of a name for a task.

        >>> policy = swarmdata.make_policy("runs/bc-coop_nav-medium", seed=1)

    Args:
        name: a registered policy such as `scripted`; a tier such as `expert` of a task of the
            package, without action noise; or the folder of a training run, whose newest policy is
            loaded.
        spec: the task; or a preset's name, or a spec file. None: that of the run's training.
        seed: of a run's training, or the number of a tier's policy; others have one policy.
        options: of a registered policy, such as `noise` or `convention`.

    Raises:
        UnknownNameError: nothing has that name.
        SpecError: the run or the tier has no such seed, there is no task, or options do not apply.
        PolicyFitError: the task does not provide what a trained policy needs.
        MissingExtraError: a run needs torch.
    """
    is_run = is_folder(name) and bool(run_folders(Path(name)))
    if options and (is_run or name not in POLICIES):
        raise SpecError(
            f"{name} is no registered policy and takes no options, got {', '.join(options)}"
        )
    if is_run:
        return _of_run(Path(name), None if spec is None else find_spec(spec), seed)
    if spec is None:
        raise SpecError(f"policy {name} needs a task: give a spec, a preset's name or a spec file")
    task = find_spec(spec)
    if name in POLICIES:
        return make_registered(str(name), task, **options)
    sources = of_tier(str(name), task, 0.0)
    if not 0 <= seed < len(sources):
        raise SpecError(f"{name} has the seeds 0 to {len(sources) - 1}, got seed {seed}")
    return make_source_policy(sources[seed], task)


def _of_run(folder: Path, spec: TaskSpec | None, seed: int) -> Policy:
    """The newest policy of a training seed; of a recording's run as it is."""
    require_extra("torch", "torch", f"loading the run {folder}")
    from swarmdata.evaluation.runs.fitted_policies import fit_policies  # noqa: PLC0415  (torch is an extra)
    from swarmdata.evaluation.runs.trained_policies import load_policies, read_trained  # noqa: PLC0415

    found = read_trained(folder)
    seeds = [each.seed for each in found.provenances]
    if seed not in seeds:
        raise SpecError(f"{folder} has the seeds {', '.join(map(str, seeds))}, got seed {seed}")
    policy = load_policies(found)[seeds.index(seed)]
    if found.spec.get("kind") == "recorded":
        if spec is not None:
            raise SpecError(
                f"{folder} was trained on a recording of {found.spec['task']} and acts there only; "
                "leave the spec out, and evaluate it with swarmdata.evaluate_parallel."
            )
        return policy
    trained = TaskSpec.parse(found.spec, str(folder))
    return fit_policies(str(folder), [policy], trained, trained if spec is None else spec)[0]
