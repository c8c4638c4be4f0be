"""Entries of the catalogue: what is shown of each dataset, with its files or without.

A published dataset whose files are not at hand is shown by its published figures and card; a
dataset that was named, or is in the cache, also has its episodes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Literal

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import MissingFileError, SpecError
from swarmdata.hub.catalog.catalog import known_references, list_datasets, load
from swarmdata.registry.published import normalized_score, published
from swarmdata.registry.recipes import find_recipe
from swarmdata.runtime.batches import Failures
from swarmdata.specs.origins import Spec
from swarmdata.specs.plain_names import without_version
from swarmdata.store.cache import cache_folder
from swarmdata.store.publication import figures_of

Kind = Literal["generated", "recorded"]


@dataclass(frozen=True, eq=False)
class Entry:
    """One dataset of the catalogue; figures that are not known are None."""

    id: str
    tier: str
    spec: Spec
    kind: Kind
    n_steps: int
    n_episodes: int | None
    n_bytes: int | None
    mean_return: float | None
    success: float | None
    clean_success: float | None
    score: float | None
    digest: str | None
    card: str | None  # Markdown
    dataset: Dataset | None  # None: its episodes are not shown

    @property
    def key(self) -> str:
        """Name of its page and of its data folder."""
        return self.id


def find_entries(
    names: Sequence[str],
    failures: Failures,
    *,
    workers: int | None = None,
    with_published: bool = True,
) -> list[Entry]:
    """Returns the entries of a catalogue, in the order of their ids.

    Args:
        names: ids, addresses or folders whose episodes are shown; they are fetched or built where
            they are absent. Without any, those in the cache.
        failures: of the batch; gets the datasets that cannot be opened.
        workers: processes that build.
        with_published: whether to add the published datasets whose episodes are not shown.

    Raises:
        SpecError: two of the names are different datasets with the same id.
    """
    opened = []
    for name in names or _cached():
        with failures.item(str(name)):
            opened.append(load(name, workers=workers))
    found: dict[str, Entry] = {}
    for dataset in opened:
        earlier = found.get(dataset.id)
        if earlier is not None and earlier.digest != dataset.digest:
            raise SpecError(
                f"two datasets are called {dataset.id}, with digests {str(earlier.digest)[:12]} "
                f"and {dataset.digest[:12]}. Show one of them, or rename the other."
            )
        found[dataset.id] = _of_dataset(dataset)
    for info in list_datasets() if with_published else ():
        if info.id not in found:
            found[info.id] = _of_published(info.id, info.n_steps, info.score)
    return [found[key] for key in sorted(found)]


def is_mini_id(dataset_id: str) -> bool:
    """Whether a dataset is called a mini, a small part of another; small ones of users are not."""
    return without_version(dataset_id).endswith("-mini")


def published_minis() -> list[str]:
    """Ids of all published datasets that are minis."""
    return [info.id for info in list_datasets() if is_mini_id(info.id)]


def _cached() -> list[Path]:
    """The folders of the finished datasets in the cache."""
    return sorted(file.parent for file in (cache_folder() / "datasets").glob("*/manifest.json"))


def _of_dataset(dataset: Dataset) -> Entry:
    manifest, spec = dataset.stored.manifest, dataset.recipe.spec
    figures = figures_of(dataset.episodes)
    references = known_references(spec)
    score = None
    if references is not None:
        score = float(normalized_score(figures.mean_return, references))
    is_generated = spec.world is not None and dataset.recipe.kind != "recording"
    tells_success = spec.world is not None or figures.success > 0
    return Entry(
        id=dataset.id,
        tier=dataset.recipe.tier,
        spec=spec,
        kind="generated" if is_generated else "recorded",
        n_steps=manifest.n_steps,
        n_episodes=manifest.n_episodes,
        n_bytes=sum(file.size for file in manifest.files.values()),
        mean_return=figures.mean_return,
        success=figures.success if tells_success else None,
        clean_success=figures.clean_success if spec.world is not None else None,
        score=score,
        digest=dataset.digest,
        card=_card_of(dataset),
        dataset=dataset,
    )


def _card_of(dataset: Dataset) -> str | None:
    try:
        return dataset.card
    except MissingFileError:
        return None  # the page says that there is none


def _of_published(dataset_id: str, n_steps: int, score: float | None) -> Entry:
    recipe, figures = find_recipe(dataset_id), published().get(dataset_id)
    file = files("swarmdata.cards").joinpath("published", f"{dataset_id}.md")
    return Entry(
        id=dataset_id,
        tier=recipe.tier,
        spec=recipe.spec,
        kind="generated",
        n_steps=n_steps,
        n_episodes=figures.n_episodes if figures else None,
        n_bytes=figures.n_bytes if figures else None,
        mean_return=figures.mean_return if figures else None,
        success=figures.success if figures else None,
        clean_success=figures.clean_success if figures else None,
        score=score,
        digest=figures.digest if figures else None,
        card=file.read_text(encoding="utf-8") if file.is_file() else None,
        dataset=None,
    )
