"""The beginning of every card: front matter, title, how to open the dataset, identity."""

from collections.abc import Sequence
from typing import Any

import yaml

from swarmdata.drawing import markdown
from swarmdata.registry.published import license_of
from swarmdata.specs.origins import Origin
from swarmdata.store import Manifest

HUB_SIZES = (
    (1_000, "n<1K"),
    (10_000, "1K<n<10K"),
    (100_000, "10K<n<100K"),
    (1_000_000, "100K<n<1M"),
)
"""The Hub's size categories: joint steps below, name."""

PROPERTIES = ("property", "value")  # header of tables that list values by name


def front_content(manifest: Manifest, origin: Origin) -> dict[str, Any]:
    """What the Hugging Face Hub reads of a card."""
    size = next((name for below, name in HUB_SIZES if manifest.n_steps < below), "1M<n<10M")
    return {
        "pretty_name": origin.id,
        "license": license_of(origin),
        "task_categories": ["reinforcement-learning", "robotics"],
        "tags": ["swarmdata", "offline-rl", "multi-agent", "zarr", origin.spec.task, origin.tier],
        "size_categories": [size],
    }


def front_matter(manifest: Manifest, origin: Origin) -> str:
    """The YAML before a card."""
    return f"---\n{yaml.safe_dump(front_content(manifest, origin), sort_keys=False)}---\n"


def identity_section(manifest: Manifest, origin: Origin) -> str:
    """Title, a snippet that opens the dataset, and a table of what identifies it."""
    spec = origin.spec
    size = sum(entry.size for entry in manifest.files.values())
    recorded = ("environment", f"`{spec.task}`")
    if spec.world is not None:
        recorded = ("task", f"`{spec.task}` version {spec.world.version}")
    rows = (
        ("id", f"`{origin.id}`"),
        recorded,
        *spec.facts,
        ("tier", origin.tier),
        ("joint steps", f"{manifest.n_steps:,}"),
        ("episodes", f"{manifest.n_episodes:,}"),
        ("size", f"{size / 1e6:,.1f} MB"),
        ("digest of the arrays", f"`{manifest.digest}`"),
        (f"hash of the {origin.kind}", f"`{manifest.recipe_hash}`"),
        ("format version", str(manifest.format_version)),
    )
    opening = f'load("{origin.id}")' if origin.recipe else 'Dataset.open("FOLDER OF THIS CARD")'
    return (
        f"\n# {origin.id}\n\n```python\nimport swarmdata\n\ndataset = swarmdata.{opening}\n```\n\n"
        + markdown.table(PROPERTIES, rows)
    )


def bullets(title: str, lines: Sequence[str]) -> str:
    """A section that is a list."""
    return f"\n## {title}\n\n" + "".join(f"- {line}\n" for line in lines)
