"""A crew that makes parts in the test's own process: quick, and it remembers what it made."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Self

import pytest

from swarmdata.building import build as build_module
from swarmdata.building.part_maker import make_part
from swarmdata.registry.components import make_env
from swarmdata.runtime.engines.jobs import Job
from swarmdata.specs.recipe import Recipe
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
        for job in jobs:
            recipe = Recipe.from_text(job.payload["recipe"])
            env = make_env(recipe.spec, 16)
            policy, part = job.payload["policy"], job.payload["part"]
            folder = Path(job.payload["folder"])
            write_part(folder, make_part(recipe, policy, part, env, progress, folder.parent))
            self.made.append(job.name)


def use_one_process(patch: pytest.MonkeyPatch) -> None:
    """Lets `build` make its parts in this process until the patch is undone."""
    patch.setattr(OneProcessCrew, "made", [], raising=False)
    patch.setattr(build_module, "open_engine", OneProcessCrew)
