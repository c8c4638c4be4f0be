"""A crew that makes parts in the test's own process: quick, and it remembers what it made."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Self

import pytest

from swarmdata.building import build as build_module
from swarmdata.building.part_maker import make_copies, make_part
from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.runtime.engines.jobs import Job
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.parts import write_part


class OneProcessCrew:
    """Makes parts in this process, and remembers which."""

    made: list[str]

    def __init__(self, engine: object, entry: str, *, n_workers: int, folder: Path) -> None:
        assert entry == build_module.PART_MAKER

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *details: object) -> None:
        pass

    def run(self, jobs: Iterable[Job], progress: Any) -> None:
        copies: dict[TaskSpec, TaskEnv] = {}  # kept from part to part, as a worker does
        for job in jobs:
            recipe = Recipe.from_text(job.payload["recipe"])
            env = copies.get(recipe.spec) or copies.setdefault(recipe.spec, make_copies(recipe))
            policy, part = job.payload["policy"], job.payload["part"]
            folder = Path(job.payload["folder"])
            write_part(folder, make_part(recipe, policy, part, env, progress, folder.parent))
            self.made.append(job.name)


def use_one_process(patch: pytest.MonkeyPatch) -> None:
    """Lets `build` make its parts in this process until the patch is undone."""
    patch.setattr(OneProcessCrew, "made", [], raising=False)
    patch.setattr(build_module, "open_engine", OneProcessCrew)
