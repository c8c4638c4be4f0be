"""Compiles every kernel beforehand, by using each world, sensor, radio and controller once."""

import os
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numba import config
from tqdm import tqdm

from swarmdata.building.build import build
from swarmdata.datasets.dataset import Dataset
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.registry.components import make_env, make_policy, make_task
from swarmdata.registry.presets import preset, preset_names
from swarmdata.registry.recipes import checkpoints, find_recipe
from swarmdata.rollouts.metrics import episode_metrics
from swarmdata.runtime.engines.crew import Crew
from swarmdata.runtime.engines.jobs import Handler, Job, Report, usable_cores
from swarmdata.runtime.kernel_progress import PROGRESS
from swarmdata.runtime.kernels import PACKAGE_FOLDER, cache_folder, digest_of
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.rules import PACKAGE_RULES

TASKS = tuple(PACKAGE_RULES)
"""Presets that are played with every sensor and radio, and of which a dataset is made, if one is
shipped."""

CONTROLLERS = ("scripted", "straight", "random", "idle")  # policies without networks

OBSERVATIONS = (
    "state", "lidar", "bearing", "occupancy", "lidar+noise-0.05+dropout-0.1+delay-2+stack-2",
    "bearing+noise-0.05", "state+noise-0.05",
)  # fmt: skip
"""One name for each way to sense."""

COMMUNICATIONS = (
    "perfect", "lossy-30", "bursty-30+delayed-2", "aloha-8", "goal+nearest-2", "errand+ring",
    "state+star", "learned-4+bits-8", "range-1.5+bandwidth-1", "goal+expires-5",
)  # fmt: skip
"""One name for each kind of payload, link, loss and limit."""

N_STEPS = 12
"""Control steps of each use; some things happen only after a few, such as a delayed message."""

N_DATASET_STEPS = 1000  # joint steps of each dataset, a few episodes

N_COPIES = 2


def warm_kernels(*, workers: int | None = None, progress: bool = True) -> int:
    """Compiles what is not compiled yet, and keeps it in `kernel_folder()`.

    `workers` processes, by default one for each core, share the kernels. Returns how many were
    compiled, each counted once for the types that it is called with.
    """
    before = kept_kernels()
    jobs = _jobs()
    hidden = None if progress else True  # None: hidden where there is no terminal
    bar = tqdm(total=len(jobs), desc="compiling kernels", unit="use", disable=hidden)

    def report(n_uses: int) -> None:
        bar.update(n_uses)

    with bar, Crew(f"{__name__}:kernel_user", workers or usable_cores()) as crew, PROGRESS.silent():
        crew.run(jobs, report)
    return len(kept_kernels() - before)


def use_kernels() -> None:
    """Uses every kernel in this process, which compiles or loads those that Python calls."""
    handle = kernel_user()
    with PROGRESS.silent():
        for job in _jobs():
            handle(job.payload, lambda amount: None)


def kernel_folder() -> Path:
    """Where compiled kernels are kept."""
    return cache_folder("", config.CACHE_DIR).parent


def kept_kernels() -> set[Path]:
    """Files of the kernels of this source; those of other versions lie beside them."""
    folders = (Path(folder) for folder, *_ in os.walk(PACKAGE_FOLDER, followlinks=True))
    files = (file.relative_to(PACKAGE_FOLDER) for each in folders for file in each.glob("*.py"))
    digests = {digest_of(".".join(("swarmdata", *file.with_suffix("").parts))) for file in files}
    return {kept for digest in digests for kept in kernel_folder().glob(f"{digest}/*/*.nbc")}


def kernel_user() -> Handler:
    """Returns what uses kernels in a worker process."""

    def handle(payload: dict[str, Any], report: Report) -> None:
        if "dataset" in payload:
            _make_dataset(payload["dataset"])
        else:
            _play(**payload)
        report(1)

    return handle


def _jobs() -> list[Job]:
    """The uses of kernels; neighbors differ, so that processes seldom wait for each other."""
    models = [
        (OBSERVATIONS[i % len(OBSERVATIONS)], COMMUNICATIONS[i % len(COMMUNICATIONS)])
        for i in range(max(len(OBSERVATIONS), len(COMMUNICATIONS)))
    ]
    backends = ["kinematic", *(["mujoco"] if find_spec("mujoco") else [])]
    presets = [n for n in preset_names() if preset(n).backend in ("pymunk", *backends)]
    trained = [task for task in TASKS if checkpoints(task, "medium")]
    uses: list[dict[str, Any]] = [
        *({"name": task, "policy": policy} for policy in CONTROLLERS for task in TASKS),
        *({"name": name, "policy": "scripted"} for name in presets if name not in TASKS),
        *(
            {"name": task, "policy": "idle", "observation": seen, "communication": heard}
            for seen, heard in models
            for task in TASKS
        ),
        *(
            {"name": task, "policy": "random", "backend": backend}
            for backend in backends
            for task in ("coop_nav", "transport")
        ),
        *({"dataset": f"{task}-medium-mini"} for task in trained),
    ]
    return [Job(" ".join(use.values()), use) for use in uses]


def _play(
    name: str,
    policy: str,
    observation: str | None = None,
    communication: str | None = None,
    backend: str | None = None,
) -> None:
    """Plays a few steps of a preset, with each of its conventions."""
    spec = with_models(preset(name), observation, communication, backend)
    env = make_env(spec, N_COPIES)
    for convention in (None, *spec.rules.conventions):
        options = {} if convention is None or policy != "scripted" else {"convention": convention}
        actor = make_policy(policy, spec, **options)
        step = env.reset(evaluation_seeds(N_COPIES))
        actor.reset(step, np.arange(N_COPIES))
        for _ in range(N_STEPS):
            step = env.step(actor.act(step))
        step = env.reset(evaluation_seeds(1), np.array([0]))
        actor.reset(step, np.array([0]))


def _make_dataset(name: str) -> None:
    """Makes a small dataset with its card, looks at it with other sensors, rewards and measures."""
    content = find_recipe(name).model_dump()
    small = {
        "n_steps": N_DATASET_STEPS,
        "part_episodes": 4,
        "policies": content["policies"][:1],  # each would have to make an episode
    }
    recipe = Recipe.parse({**content, **small})
    with TemporaryDirectory() as folder, ThreadPoolExecutor(1) as this_process:
        path = build(recipe, Path(folder) / recipe.id, engine=this_process, progress=False)
        dataset = Dataset.open(path)
        dataset.reobserve("lidar", "lossy-30", progress=False)
        dataset.with_rewards(team_share=0.5)
        episode_metrics(dataset[0], make_task(recipe.spec))
