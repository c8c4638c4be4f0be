"""From a name to one policy that acts, `make_policy`, or to the behavior policies of a recipe."""

import hashlib
import inspect
import re
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from swarmdata.behavior_policies.learned import own_actor
from swarmdata.errors import CheckpointError, SpecError, UnknownNameError, check_type
from swarmdata.evaluation.runs.provenance import Provenance
from swarmdata.interfaces import Policy
from swarmdata.learn.training.run_files import POLICIES as SAVED
from swarmdata.learn.training.run_files import find_run, run_hash, seeds_of
from swarmdata.registry.components import POLICIES, checkpoint_free_policies, policy_class
from swarmdata.registry.components import make_policy as make_registered
from swarmdata.registry.presets import find_spec
from swarmdata.registry.recipes import FAMILY_SPECS, against, side_sources, sources
from swarmdata.registry.tiers import TRAINED_TIERS
from swarmdata.rollouts.recipe_episodes import make_source_policy
from swarmdata.runtime.extras import require_extra
from swarmdata.runtime.own_components import code_of
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.plain_names import repeated
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.layout import CHECKPOINTS

if TYPE_CHECKING:
    from swarmdata.evaluation.runs.trained_policies import Trained

EXACT_TOLERANCE = 0.02
"""Most by which exact inference may change an action, in [-1, 1]; else the network is kept."""

N_COMPARED_EPISODES = 8
"""Validation episodes on which exact inference is compared with the trained network."""

_NOT_PLAIN = re.compile(r"[^A-Za-z0-9_+]+")


class Behavior(NamedTuple):
    """A behavior policy of a recipe, and how it came to it."""

    source: PolicySource
    error: float | None = None  # largest change of an action by exact inference; None: not measured

    def __str__(self) -> str:
        """One line."""
        if any(each.name == "network" for each in self.source.acting):
            return f"{self.source.label}: not exact; another machine may give other episodes"
        if self.error is not None:
            return f"{self.source.label}: exact; rounded weights change actions by {self.error:.2g}"
        return f"{self.source.label}: exact"


def behaviors_of(
    name: str, share: float, spec: TaskSpec, noise: float, folder: Path
) -> tuple[Behavior, ...]:
    """Returns the behavior policies that a name means, one for each seed of a run, or all it saved.

    A name is as `generate` takes it; or a registered policy, a tier or a run for each side of the
    task, such as `tag-greedy,runs/evader`. The policies have equal parts of a share of the joint
    steps; those that take no noise, such as `random`, act without. Copies of networks go into the
    folder's `checkpoints`. Raises as `generate` does.
    """
    if "," in name:
        found = tuple(_of_sides(name, spec, noise, folder / CHECKPOINTS))
    elif (run := _find_trained(name)) is not None:
        policies = run.fitted(spec, "Record it in its environment with swarmdata.Recorder.")
        found = tuple(_copies(run, policies, spec, noise, folder / CHECKPOINTS))
    elif name in checkpoint_free_policies():
        found = (Behavior(_registered(name, name, spec, noise)),)
    else:
        found = tuple(map(Behavior, of_tier(name, spec, noise)))
    whole = sum(each.source.share for each in found)
    return tuple(
        each._replace(
            source=each.source.model_copy(update={"share": share * each.source.share / whole})
        )
        for each in found
    )


def _of_sides(names: str, spec: TaskSpec, noise: float, folder: Path) -> Iterator[Behavior]:
    """Each policy of one side against each of the others; names are separated by commas."""
    sides, each = [side.name for side in spec.sides], names.split(",")
    if len(each) != len(sides):
        raise SpecError(
            f"{names} names {len(each)} policies, but {spec.task} has the sides "
            f"{', '.join(sides)}. Name one policy for each, in this order"
        )
    seats = [_of_side(*pair, spec, noise, folder) for pair in zip(sides, each, strict=True)]
    for team in product(*seats):
        playing = [behavior.source for behavior in team]
        errors = [behavior.error for behavior in team if behavior.error is not None]
        label = "-vs-".join(each.label for each in playing)
        yield Behavior(against(playing, sides, label), max(errors, default=None))


def _of_side(
    side: str, name: str, spec: TaskSpec, noise: float, folder: Path
) -> tuple[Behavior, ...]:
    """The policies that a name means for a side, as `behaviors_of` does."""
    if (found := _find_trained(name)) is None:
        if name in checkpoint_free_policies():
            return (Behavior(_registered(name, name, spec, noise)),)
        return tuple(map(Behavior, tier_of_side(name, side, spec, noise)))
    if found.side is None or (found.side.side, found.side.whole) != (side, spec):
        raise SpecError(
            f"{name} was not trained for the side {side} of {spec.task} as it is here, and cannot "
            "play it"
        )
    return tuple(_copies(found, found.policies(), found.side, noise, folder))


def _find_trained(name: str) -> "Trained | None":
    """The run of a name, or of its folder `policies`, then with all that it saved."""
    if (run := find_run(name)) is not None:
        return open_run(run)
    saved = Path(name)
    if saved.name == SAVED and saved.is_dir() and (run := find_run(saved.parent)) is not None:
        return open_run(run).with_earlier()
    return None


def _registered(label: str, name: str, spec: TaskSpec, noise: float) -> PolicySource:
    return PolicySource(label=label, name=name, noise=noise if takes_noise(name, spec) else 0.0)


def takes_noise(name: str, spec: TaskSpec) -> bool:
    """Whether the policies that a name means have action noise, or one of several sides has."""
    if "," in name:
        return any(takes_noise(each, spec) for each in name.split(","))
    if name not in checkpoint_free_policies():
        return True
    return "noise" in inspect.signature(policy_class(name, spec)).parameters


def of_tier(name: str, spec: TaskSpec, noise: float = 0.0) -> tuple[PolicySource, ...]:
    """The policies of a tier of a task of the package."""
    family = family_of(spec)
    trained = {tier for tier in TRAINED_TIERS if family is not None and sources(family, tier)}
    if family is not None and name in trained:
        return sources(family, name, noise)
    known = checkpoint_free_policies() | trained
    if "/" in name or Path(name).exists():
        raise SpecError(
            f"{name} is not a run folder: there is no config.json in it. Expected the folder of a "
            f"training run, or one of {', '.join(sorted(known))}."
        )
    raise UnknownNameError("policy, tier or run folder", name, known)


def tier_of_side(
    name: str, side: str, spec: TaskSpec, noise: float = 0.0
) -> tuple[PolicySource, ...]:
    """The policies of a tier that play a side; UnknownNameError if the task has none."""
    family = family_of(spec)
    if family is None or not (found := side_sources(family, name, side, noise)):
        tiers = [each for each in TRAINED_TIERS if family and side_sources(family, each, side)]
        known = {*checkpoint_free_policies(), *tiers}
        raise UnknownNameError("registered policy, tier or run folder of a side", name, known)
    return found


def family_of(spec: TaskSpec) -> str | None:
    """The preset with datasets that is this task."""
    return next((each for each, known in FAMILY_SPECS.items() if known == spec), None)


def _copies(
    run: "Trained", policies: Sequence[Policy], spec: TaskSpec | SideSpec, noise: float,
    folder: Path,
) -> Iterator[Behavior]:  # fmt: skip
    """Copies the policies of a run: for exact inference if they can be, else as they are."""
    from swarmdata.learn.policies.policy_file import save_policy  # noqa: PLC0415  (torch is an extra)

    folder.mkdir(parents=True, exist_ok=True)
    stem = _NOT_PLAIN.sub("-", run.folder.resolve().name).strip("-") or "run"
    one_each = not repeated(str(each.seed) for each in run.provenances)
    for provenance, policy in zip(run.provenances, policies, strict=True):
        age = "" if one_each else f"-{provenance.frames}"
        label, fresh = f"{stem}-{provenance.seed}{age}", folder / "new.safetensors"
        error = _exact_copy(policy, spec, fresh)
        if error is None:
            save_policy(fresh, policy)
        sha256 = hashlib.sha256(fresh.read_bytes()).hexdigest()
        path = fresh.rename(folder / f"{label}-{sha256[:12]}.safetensors")
        kind = "network" if error is None else "learned"
        source = PolicySource(
            label=label, name=kind, checkpoint=path.name, sha256=sha256, noise=noise
        )
        yield Behavior(source, error)


def _exact_copy(policy: Policy, spec: TaskSpec | SideSpec, path: Path) -> float | None:
    """Writes a policy for exact inference: the largest change of an action, None if too large."""
    from swarmdata.online_algos.runs.export_policy import (  # noqa: PLC0415  (torch is an extra)
        action_error,
        can_be_exact,
        export_actor,
    )

    if not can_be_exact(policy):
        return None
    try:
        export_actor(policy, path, spec.n_agents)
    except CheckpointError:  # its weights are too large, or a layer is too wide
        return None
    error = action_error(policy, own_actor(path, spec), spec, N_COMPARED_EPISODES)
    return error if error <= EXACT_TOLERANCE else None


def find_opponents(name: str, side: str, spec: TaskSpec) -> tuple[Policy | str, str]:
    """Who plays against a side, as `play_sides` takes it, and its name in results.

    Of a run, the first seed plays; of a tier, the first policy.
    """
    spec.side(side)
    if (run := find_run(name)) is not None:
        found = open_run(run)
        other = found.side
        if other is None or other.side == side or other.whole.rules != spec.rules:
            raise SpecError(
                f"{name} was not trained for another side of {spec.task} than {side}, and cannot "
                "play against it"
            )
        first = found.provenances[0]
        return found.policies()[0], f"{first.label}@{str(first.content)[:8]}"
    if name in checkpoint_free_policies():
        code = opponents_hash(name)
        return name, name if code is None else f"{name}@{code[:8]}"
    played = next(each.name for each in spec.sides if each.name != side)
    source = tier_of_side(name, played, spec)[0]
    policy = make_source_policy(source, SideSpec(whole=spec, side=played))
    return policy, f"{name}@{str(source.sha256)[:8]}"


def opponents_hash(name: str) -> str | None:
    """The hash of the run, or of the user's code, that plays against a side; None: neither."""
    run = find_run(name)
    return code_of("policies", name) if run is None else run_hash(*seeds_of([run])[0])


def make_policy(
    name: str | Path,
    spec: TaskSpec | Path | str | None = None,
    *,
    seed: int | None = None,
    side: str | None = None,
    **options: Any,
) -> Policy:
    """Builds the policy of a name for a task.

        >>> policy = swarmdata.make_policy("runs/bc-coop_nav-medium", seed=1)

    Args:
        name: a registered policy such as `scripted`; a tier such as `expert` of a task of the
            package, without action noise; or a training run, by its folder or as
            `zoo:ALGORITHM/DATASET`, whose newest policy is loaded.
        spec: the task; or a preset's name, or a spec file. None: that of the run's training.
        seed: of a run's training, or the number of a tier's policy; None: the first. Others have
            one policy.
        side: of a tier, its policy that plays this side, as `evaluate` and `train_online` take
            `opponents`.
        options: of a registered policy, such as `noise` or `convention`.

    Raises:
        UnknownNameError: nothing has that name, or the task has no such side.
        SpecError: the run or the tier has no such seed, there is no task, or a side or options do
            not apply.
        PolicyFitError: the task does not provide what a trained policy needs.
        MissingExtraError: a run needs torch.
    """
    check_type("the name", name, (str, Path), "a registered policy, a tier or a run folder")
    run = find_run(name)
    if options and (run is not None or name not in POLICIES):
        raise SpecError(
            f"{name} is no registered policy and takes no options, got {', '.join(options)}"
        )
    if side is not None and (run is not None or name in checkpoint_free_policies()):
        raise SpecError(
            f"{name} is no tier and takes no side, got side {side!r}: leave it out, since a run "
            "plays the side of its training, and a registered policy, by its name, any"
        )
    if run is not None:
        found = open_run(run)
        index = index_of(seed, found.provenances, run)
        if spec is None:
            return found.policies()[index]
        advice = "Leave the spec out, and evaluate it with swarmdata.evaluate_parallel."
        return found.fitted(find_spec(spec), advice)[index]
    if spec is None:
        raise SpecError(f"policy {name} needs a task: give a spec, a preset's name or a spec file")
    task = find_spec(spec)
    if name in POLICIES:
        return make_registered(str(name), task, **options)
    return _policy_of_tier(str(name), task, seed or 0, side)


def index_of(seed: int | None, provenances: Sequence[Provenance], name: object) -> int:
    """The place of a seed among a run's; None: the first. SpecError if there is no such seed."""
    seeds = [each.seed for each in provenances]
    if seed is None:
        return 0
    if seed not in seeds:
        raise SpecError(f"{name} has the seeds {', '.join(map(str, seeds))}, got seed {seed}")
    return seeds.index(seed)


def _policy_of_tier(name: str, task: TaskSpec, seed: int, side: str | None) -> Policy:
    """One of the policies of a tier, of all sides or of one."""
    played: TaskSpec | SideSpec = task
    if side is None:
        sources = of_tier(name, task)
    else:
        task.side(side)
        sources, played = tier_of_side(name, side, task), SideSpec(whole=task, side=side)
    if not 0 <= seed < len(sources):
        raise SpecError(f"{name} has the seeds 0 to {len(sources) - 1}, got seed {seed}")
    return make_source_policy(sources[seed], played)


def open_run(run: Path) -> "Trained":
    """Reads a run folder of offline or online training."""
    require_extra("torch", "torch", f"loading the run {run}")
    from swarmdata.evaluation.runs.trained_policies import read_trained  # noqa: PLC0415  (torch)

    return read_trained(run)
