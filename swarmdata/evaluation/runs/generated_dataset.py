"""A dataset of one's own task and policies, in one call: `generate`."""

import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from tempfile import TemporaryDirectory

from swarmdata.building.build import build
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SpecError, list_of
from swarmdata.evaluation.runs.named_policies import Behavior, behaviors_of, takes_noise
from swarmdata.hub.catalog.catalog import load
from swarmdata.registry.presets import find_spec
from swarmdata.registry.recipes import check_own_id, part_size
from swarmdata.runtime.cache_folder import cache_folder
from swarmdata.runtime.engines.open_engine import LOCAL
from swarmdata.specs.model_choice import Ranges, Source, chosen_models
from swarmdata.specs.plain_names import repeated
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import TaskSpec

DEFAULT_STEPS = 50_000  # joint steps of a dataset unless more are asked for: those of a mini

DEFAULT_TIER = "own"


def generate(
    task: str | Path | TaskSpec,
    policies: str | Path | Sequence[str | Path] | Mapping[str, float],
    *,
    id: str,
    n_steps: int = DEFAULT_STEPS,
    noise: float = 0.0,
    observation: Source | None = None,
    communication: Source | None = None,
    backend: str | None = None,
    randomization: Ranges | None = None,
    seed: int | None = None,
    tier: str = DEFAULT_TIER,
    metadata: Mapping[str, str] | None = None,
    out: Path | str | None = None,
    workers: int | None = None,
    engine: str | Executor = LOCAL,
    progress: bool = True,
    report: Callable[[Behavior], None] = lambda behavior: None,
) -> Dataset:
    """Makes a dataset of policies in a task: with card, splits and a recipe that makes it again.

        >>> mine = swarmdata.generate("my-task.yaml", ["runs/mine", "scripted"],
        ...                           id="my_task-mine-v0", n_steps=200_000, noise=0.1)

    The newest policy of each seed of a run is copied into the dataset. A perceptron that all robots
    share, with its weights rounded to multiples of 2^-12, has the same bits on every machine and is
    called `learned` in the recipe. Any other network (memories, sets, flows, a network for each
    robot) is called `network`: another machine usually makes the same dataset from it, and does not
    have to.

    The call may be killed and repeated: parts that are finished are kept.

    Args:
        task: a preset's name, a spec file, or a spec.
        policies: registered policies such as `scripted`, tiers such as `expert`, and run folders
            of offline or online training; they have equal shares of the joint steps, and so have
            the seeds of a run. A mapping gives their shares: `{"runs/mine": 3, "random": 1}`.
            The folder `runs/mine/policies` of an online run means all that it saved on the way.
        id: of the dataset, such as `my_task-mine-v0`. With it `load` finds the dataset in the
            cache.
        n_steps: least number of joint steps.
        noise: standard deviation of the Gaussian noise on the actions of trained and scripted
            policies.
        observation: observation model, such as `lidar`; None: that of the task.
        communication: communication model, such as `lossy-30`; None: that of the task.
        backend: simulator, such as `mujoco`; None: that of the task.
        randomization: ranges from which each episode draws, such as `{"mass": (1, 2)}`; None:
            those of the task.
        seed: of the episodes, below 2^32. Datasets with different seeds share no episode. None: a
            number made of the id.
        tier: name of the data's quality, for the card.
        metadata: information for readers, such as `author`, `license` and `description`; the
            license is unknown unless it is given.
        out: folder of the dataset; None: in the cache.
        workers: processes of the engine `local` that simulate; by default one for each core.
        engine: where parts are made, as `build` takes it.
        progress: whether to show a bar.
        report: called with each policy of the recipe once its network is copied.

    Raises:
        UnknownNameError: no such task, policy or model.
        SpecError: the id is taken or malformed, or something in the recipe is.
        PolicyFitError: the task does not provide what a trained policy needs.
        RecipeConflictError: a dataset of another recipe is in the folder.
        MissingExtraError: a run folder needs torch.
    """
    spec = chosen_models(find_spec(task), observation, communication, backend, randomization)
    check_own_id(id)
    if not isinstance(noise, int | float) or not 0 <= noise < math.inf:
        raise SpecError(f"noise is {noise!r:.100}, expected a standard deviation of at least 0")
    shares = _shares(policies)
    if noise and not any(takes_noise(name, spec) for name in shares):
        raise SpecError(f"none of the policies {', '.join(shares)} has action noise; leave it out")
    with TemporaryDirectory(prefix="swarmdata-generate-") as scratch:
        sources = _sources(shares, spec, noise, Path(scratch), report)
        recipe = _recipe(
            spec, sources, id=id, tier=tier, seed=seed, n_steps=n_steps,
            metadata=dict(metadata or {}),
        )  # fmt: skip
        folder = cache_folder() / "datasets" / id if out is None else Path(out)
        folder.parent.mkdir(parents=True, exist_ok=True)
        build(
            recipe, folder, checkpoints=Path(scratch), workers=workers, engine=engine,
            progress=progress,
        )  # fmt: skip
    return load(folder)


def _recipe(
    spec: TaskSpec, policies: Sequence[PolicySource], *, id: str, tier: str, seed: int | None,
    n_steps: int, metadata: Mapping[str, str],
) -> Recipe:  # fmt: skip
    rarest = min(policies, key=lambda source: source.share)
    part = rarest.share / sum(source.share for source in policies)
    if n_steps * part < spec.horizon:  # every policy needs an episode as long as the horizon
        raise SpecError(
            f"{n_steps:,} steps leave {n_steps * part:,.0f} to policy {rarest.label!r}, less than "
            f"one episode of {spec.horizon} steps; expected at least {spec.horizon / part:,.0f}"
        )
    content = {
        "id": id,
        "tier": tier,
        "spec": spec.model_dump(mode="json"),
        "policies": [source.model_dump() for source in policies],
        "seed": zlib.crc32(id.encode()) if seed is None else seed,
        "n_steps": n_steps,
        "metadata": metadata,
        "part_episodes": part_size(spec, policies, n_steps),
    }
    return Recipe.parse(content, f"the recipe of {id}")


def _shares(
    policies: str | Path | Sequence[str | Path] | Mapping[str, float],
) -> dict[str, float]:
    if isinstance(policies, Mapping):
        shares = {str(name): float(share) for name, share in policies.items()}
    else:
        names = list_of("policies", policies, "the name of a policy or a run folder")
        if twice := repeated(map(str, names)):
            raise SpecError(f"policies are named twice: {', '.join(twice)}")
        shares = dict.fromkeys(map(str, names), 1.0)
    if not shares:
        raise SpecError("no policies, expected at least one, such as 'scripted' or a run folder")
    if wrong := [f"{name} {share:g}" for name, share in shares.items() if not 0 < share < 1e12]:
        raise SpecError(f"the share of a policy is a positive number, got {', '.join(wrong)}")
    return shares


def _sources(
    shares: Mapping[str, float],
    spec: TaskSpec,
    noise: float,
    folder: Path,
    report: Callable[[Behavior], None],
) -> list[PolicySource]:
    """The policies of all names, whose networks are copied into a folder; labels are unique."""
    found: dict[str, PolicySource] = {}
    for name, share in shares.items():
        for behavior in behaviors_of(name, share, spec, noise, folder):
            report(behavior)
            label = behavior.source.label
            labels = (label, *(f"{label}.{k}" for k in range(2, 300)))
            free = next(each for each in labels if each not in found)
            found[free] = behavior.source.model_copy(update={"label": free})
    return list(found.values())
