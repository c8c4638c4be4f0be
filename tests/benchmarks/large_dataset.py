"""A synthetic dataset of the size of a real one, for benchmarks."""

from pathlib import Path

from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import Manifest
from swarmdata.store.assembly import assemble
from swarmdata.store.episode_order import merge_order
from swarmdata.store.parts import write_part
from swarmdata.store.scratch import remove_scratch, scratch_folder
from swarmdata.testing.synthetic import make_episode, make_recipe


def make_large_dataset(out: Path, n_steps: int) -> Manifest:
    """Writes a dataset of the size and shapes of a real one, episodes of 125 steps."""
    length, per_part = 125, 64
    sizes = {"n_agents": 4, "n_features": 53, "n_states": 32, "n_values": 0, "n_obstacles": 6}
    n_parts = -(-n_steps // (length * per_part))
    scratch = scratch_folder(out, "synthetic")
    parts = [scratch / f"part-{k:04d}" for k in range(n_parts)]
    for k, part in enumerate(parts):
        seeds = range(k * per_part, (k + 1) * per_part)
        write_part(part, [make_episode(length, seed, **sizes) for seed in seeds])
    recipe = make_recipe(n_steps, spec=TaskSpec())
    order = merge_order(recipe, [[length] * (n_parts * per_part)]).order
    manifest = assemble(out, recipe=recipe, parts={0: parts}, order=order)
    remove_scratch(scratch)
    return manifest
