"""The parts that begin every card, and lists."""

from collections.abc import Sequence

import yaml

from swarmdata.cards.sections.origin import license_of
from swarmdata.specs.origins import Origin
from swarmdata.store import Manifest

SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
"""The Hub's size categories, by joint steps below."""


def front_matter(manifest: Manifest, recipe: Origin) -> str:
    """What the Hub reads."""
    size = next((name for below, name in SIZES if manifest.n_steps < below), "1M<n<10M")
    content = {
        "pretty_name": recipe.id,
        "license": license_of(recipe),
        "task_categories": ["reinforcement-learning", "robotics"],
        "tags": ["swarmdata", "offline-rl", "multi-agent", "zarr", recipe.spec.task, recipe.tier],
        "size_categories": [size],
    }
    return f"---\n{yaml.safe_dump(content, sort_keys=False)}---\n"


def snippet(opening: str) -> str:
    """How to open the dataset."""
    return f"```python\nimport swarmdata\n\ndataset = swarmdata.{opening}\n```\n"


def bullets(title: str, lines: Sequence[str]) -> str:
    """A section that is a list."""
    return f"\n## {title}\n\n" + "".join(f"- {line}\n" for line in lines)
