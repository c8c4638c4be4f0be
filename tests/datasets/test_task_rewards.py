"""Converted data with rewards of somebody else: no score, and nowhere the rewards of the task."""

from functools import partial
from pathlib import Path

import h5py
import pytest

from swarmdata.cards.card import card_of
from swarmdata.catalogue.entries import find_entries
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError
from swarmdata.hub.catalog import catalog
from swarmdata.hub.catalog.catalog import load
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.export import export_dataset
from swarmdata.runtime.batches import Failures
from tests.support.measured import references_at


def converted(tiny: Path, folder: Path, more: float) -> Path:
    """A copy by way of another format, whose robots get more in each step."""
    exported = export_dataset(Dataset.open(tiny), folder / "export", format="d4rl")
    (file,) = exported.rglob("*.hdf5") if exported.is_dir() else (exported,)
    with h5py.File(file, "r+") as opened:
        for name in ("rewards", "infos/agent_rewards"):
            opened[name][...] += more
    out = folder / "coop_nav-copy-v0"
    import_dataset(exported, out, format="d4rl", id="coop_nav-copy-v0")
    return out


@pytest.mark.parametrize(("more", "is_own"), [(0.0, True), (0.01, False)])
def test_only_rewards_of_the_task_have_a_score(
    more: float,
    is_own: bool,
    tiny: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    known = partial(references_at, idle=-1.0, random=-1.0, expert=1.0)
    monkeypatch.setattr(catalog, "references_of", known)
    out = converted(tiny, tmp_path, more)
    assert ("have no score" in caplog.text) != is_own
    dataset = load(out)
    assert (dataset.references is not None) == is_own
    streamed = load(out, stream=True)
    assert (streamed.references is not None) == is_own
    if not is_own:
        with pytest.raises(SchemaError, match="other rewards than its task"):
            dataset.normalized_score(0.0)
    assert ("not those of the task" in card_of(out)) != is_own
    (entry,) = find_entries([str(out)], Failures(1), with_published=False)
    assert (entry.score is not None) == is_own
    assert (entry.reward_spec is not None) == is_own
