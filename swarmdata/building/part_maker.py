"""What a worker process of a build does: parts, and at last the dataset's card."""

from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.envs.world.task_env import TaskEnv
from swarmdata.interfaces import VecEnv
from swarmdata.registry.components import make_env
from swarmdata.rollouts.recipe_episodes import SIMULATED_COPIES, episode_seeds, make_source_policy
from swarmdata.rollouts.rollout import rollout
from swarmdata.runtime.engines.jobs import Handler, Report
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.parts import write_part
from swarmdata.types import Episode


def make_part(
    recipe: Recipe,
    policy: int,
    part: int,
    env: VecEnv,
    report: Report = lambda steps: None,
    folder: Path | None = None,
) -> list[Episode]:
    """Simulates part number `part` of one policy's stream, the same in any number of copies.

    `report` is called with the joint steps of each; `folder` has the recipe's own networks, if any.
    """
    first, n = part * recipe.part_episodes, recipe.part_episodes
    seeds = episode_seeds(recipe, policy, np.arange(first, first + n))
    actor = make_source_policy(recipe.policies[policy], recipe.spec, folder)
    episodes = []
    for episode in rollout(env, actor, seeds, policy_index=policy):
        episodes.append(episode)
        report(len(episode))
    return episodes


def make_copies(recipe: Recipe) -> TaskEnv:
    """Returns the copies of the recipe's task that parts are simulated in."""
    n_copies = min(SIMULATED_COPIES, recipe.part_episodes)  # more would have no episode to run
    env = make_env(recipe.spec, n_copies)
    assert isinstance(env, TaskEnv)
    return env


def part_maker() -> Handler:
    """Returns what makes parts, and the card, in a worker process."""
    copies: dict[tuple[TaskSpec, int], TaskEnv] = {}  # kept from part to part

    def handle(payload: dict[str, Any], report: Report) -> None:
        if "finish" in payload:
            from swarmdata.cards.side_files import finish  # noqa: PLC0415  (for one job of a build)

            finish(Path(payload["finish"]))
            return
        recipe = Recipe.from_text(payload["recipe"])
        kind = recipe.spec, recipe.part_episodes
        if kind not in copies:
            copies[kind] = make_copies(recipe)
            if (payload["policy"] + payload["part"]) % 2:  # where two begin, they compile apart
                copies[kind].compile_physics()
        env = copies[kind]
        out = Path(payload["folder"])
        episodes = make_part(recipe, payload["policy"], payload["part"], env, report, out.parent)
        write_part(out, episodes)

    return handle
