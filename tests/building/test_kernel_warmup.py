"""After a warm-up, nothing is left to compile."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from swarmdata.building import kernel_warmup
from swarmdata.building.build import build
from swarmdata.building.kernel_warmup import kept_kernels, warm_kernels
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.registry.recipes import find_recipe
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.recipe import Recipe


def test_every_use_is_known_and_there_once() -> None:
    names = [job.name for job in kernel_warmup._jobs()]
    assert len(set(names)) == len(names)
    for observation in kernel_warmup.OBSERVATIONS:
        assert with_models(preset("coop_nav"), observation).observation
    for communication in kernel_warmup.COMMUNICATIONS:
        assert with_models(preset("coop_nav"), None, communication).communication
    for controller in kernel_warmup.CONTROLLERS:
        assert make_policy(controller, preset("coop_nav"))


@pytest.mark.slow
def test_nothing_is_left_to_compile(tmp_path: Path) -> None:
    warm_kernels(progress=False)
    before = kept_kernels()
    assert before

    content = find_recipe("coop_nav-expert-mini").model_dump()
    recipe = Recipe.parse({**content, "n_steps": 2000, "part_episodes": 4})
    build(recipe, tmp_path / recipe.id, workers=1, progress=False)
    specs = [preset(name) for name in ("transport", "warehouse-hard", "formation-circle")]
    others = ("kinematic", "mujoco") if find_spec("mujoco") else ("kinematic",)
    specs += [preset("coop_nav").with_updates(backend=backend) for backend in others]
    for spec in specs:
        seeds = np.arange(2, dtype=np.uint64)
        list(rollout(make_env(spec, 2), make_policy("scripted", spec, noise=0.1), seeds))

    assert kept_kernels() == before
    assert warm_kernels(progress=False) == 0
