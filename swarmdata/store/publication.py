"""The published entry of a stored dataset: figures, digests, and versions."""

import math
from dataclasses import asdict

import numpy as np

from swarmdata.registry.published import Figures, Published
from swarmdata.store.stored_dataset import StoredDataset
from swarmdata.store.table import EpisodeTable, clean_successes


def publication(stored: StoredDataset) -> Published:
    """Returns the entry that is published for a built dataset."""
    manifest, table = stored.manifest, stored.table
    spec = stored.recipe.spec
    labels = [source.label for source in stored.recipe.policies]
    return Published(
        **asdict(figures_of(table)),
        task=spec.task,
        n_agents=spec.n_agents,
        recipe_hash=manifest.recipe_hash,
        digest=manifest.digest,
        transport_digest=manifest.transport_digest,
        n_bytes=sum(entry.size for entry in manifest.files.values()),
        policies={
            label: figures_of(table.take(np.flatnonzero(table.policy == index)))
            for index, label in enumerate(labels)
            if (table.policy == index).any()
        },
        made_with=manifest.provenance,
    )


def figures_of(table: EpisodeTable) -> Figures:
    """Figures of all episodes of a table; means are of exact sums, the same on every machine."""
    return Figures(
        n_steps=int(table.lengths.sum()),
        n_episodes=len(table),
        mean_return=math.fsum(table.team_return.tolist()) / len(table),
        success=int(table.success.sum()) / len(table),
        clean_success=int(clean_successes(table).sum()) / len(table),
    )
