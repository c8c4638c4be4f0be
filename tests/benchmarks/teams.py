"""The teams that benchmarks play: simple and scripted policies, and the shipped checkpoints."""

from swarmdata.interfaces import Policy
from swarmdata.registry.components import make_policy
from swarmdata.registry.recipes import TRAINED_TIERS, sources
from swarmdata.rollouts.recipe_episodes import make_source_policy
from swarmdata.specs.task_spec import TaskSpec


def members(team: str, preset: str, spec: TaskSpec) -> list[Policy]:
    """The policies of a team, which have equal shares; none if a tier has no checkpoints.

    Args:
        team: a registered policy, or a tier, whose checkpoints act without noise.
        preset: whose checkpoints are meant.
        spec: the task to act in.
    """
    if team not in TRAINED_TIERS:
        return [make_policy(team, spec)]
    return [make_source_policy(source, spec) for source in sources(preset, team, noise=0.0)]
