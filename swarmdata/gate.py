"""The gate before a push: every reason against publishing a dataset."""

import tempfile
from collections.abc import Callable
from pathlib import Path

from swarmdata.behavior_policies.tier_bands import out_of_band
from swarmdata.behavior_policies.tiers import FAMILIES, SPECS, shipped_recipes
from swarmdata.cards.render import card_of
from swarmdata.cards.schema import published, references_of
from swarmdata.errors import DatasetError, HubError, SchemaError, SpecError
from swarmdata.remotes import Remote
from swarmdata.store import StoredDataset, open_store
from swarmdata.store.layout import CARD, MANIFEST
from swarmdata.store.manifest import MAX_BYTES

BANDED = {"medium": ("medium",), "expert": ("expert",), "medium-expert": ("medium", "expert")}
"""Tiers whose policies have bands, and whose measured figures decide."""


def reasons_against(folder: Path, remote: Remote) -> tuple[str, ...]:
    """Every reason against publishing a dataset to a remote; none: it may be published.

    Args:
        folder: the dataset's; every byte of it is read and compared with its manifest.
        remote: where to.

    Raises:
        HubError: the remote could not be asked whether the version is taken.
    """
    try:
        stored = open_store(folder, "full")
    except DatasetError as error:
        return (str(error),)  # nothing else of it can be trusted
    found = [reason for check in CHECKS for reason in check(stored)]
    return (*found, *_of_version(stored, remote))


def _of_card(stored: StoredDataset) -> tuple[str, ...]:
    """The card is what the files say, so that no number on it was typed."""
    card, advice = stored.path / CARD, f"`swarmdata card {stored.path} --write` writes it anew."
    try:
        expected = card_of(stored.path)
    except (SchemaError, SpecError) as error:
        return (f"no card can be made of it: {error}",)
    if not card.is_file():
        return (f"it has no {CARD}. {advice}",)
    if card.read_bytes() != expected.encode():
        return (f"{card} is not what the files say. {advice}",)
    return ()


def _of_identity(stored: StoredDataset) -> tuple[str, ...]:
    """An id of the package means one dataset everywhere."""
    recipe, manifest = stored.recipe, stored.manifest
    shipped, entry = shipped_recipes().get(recipe.id), published().get(recipe.id)
    if shipped is not None and shipped.hash() != recipe.hash():
        return (f"{recipe.id} is the id of a shipped recipe, and it was made from another one.",)
    if entry is not None and entry.digest != manifest.digest:
        return (
            f"its digest is {manifest.digest}, but {recipe.id} was published with {entry.digest}.",
        )
    return ()


def _of_tier(stored: StoredDataset) -> tuple[str, ...]:
    """The shipped policies behind a tier keep its bands, as measured on the reserved seeds."""
    recipe = stored.recipe
    measured = references_of(recipe.spec.hash())
    family = next((name for name in FAMILIES if SPECS[name] == recipe.spec), None)
    if measured is None or family is None or recipe.id not in shipped_recipes():
        return ()
    if not {"scripted", "medium", "expert"} <= set(measured.policies):
        return ()
    figures = {
        policy: {name: value.value for name, value in metrics.items() if value is not None}
        for policy, metrics in measured.policies.items()
    }
    wanted = tuple(f"{family}: {policy} " for policy in BANDED.get(recipe.tier, ()))
    return tuple(problem for problem in out_of_band(family, figures) if problem.startswith(wanted))


CHECKS: tuple[Callable[[StoredDataset], tuple[str, ...]], ...] = (_of_card, _of_identity, _of_tier)
"""Each returns its reasons, given a dataset whose bytes are intact. A semantic audit of the
episodes is one more entry."""


def _of_version(stored: StoredDataset, remote: Remote) -> tuple[str, ...]:
    """A version that is taken stays; the same files under it are no reason, a push ends at once."""
    release = remote.find(stored.manifest.id)
    if release is None:
        return ()
    with tempfile.TemporaryDirectory() as scratch:
        there = Path(scratch, MANIFEST)
        try:
            remote.read(release, MANIFEST, there, MAX_BYTES)
        except HubError as error:
            return (f"the version is taken at {release.address}, and cannot be compared: {error}",)
        if there.read_bytes() == (stored.path / MANIFEST).read_bytes():
            return ()
    return (
        f"the version is taken: {release.address} is another dataset, and a published version never"
        " changes. Publish this one under the next version.",
    )
