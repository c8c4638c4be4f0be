"""An edited dataset whose data is lost is made again from its parents, by `load` or a repair."""

import json
import shutil
from pathlib import Path

import pytest

from swarmdata.building.edit import combine_datasets, filter_dataset
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import DatasetError, DatasetNotFoundError, MissingManifestError, SpecError
from swarmdata.hub.catalog.catalog import load
from swarmdata.hub.catalog.repair import MADE_AGAIN, examine, repair
from tests.support.pairs import slow
from tests.support.tiny import Shelf, contents, flip, make_tiny

PARENT, EDIT, EDIT_OF_EDIT = "lab-parent_run-v0", "lab-some-v0", "lab-few-v0"

pytestmark = pytest.mark.usefixtures("one_process")


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_tiny(tmp_path_factory.mktemp("original") / PARENT, id=PARENT)


@pytest.fixture
def parent(original: Path, cache_folder: Path) -> Path:
    """The parent, in the cache."""
    return Path(shutil.copytree(original, cache_folder / "datasets" / PARENT))


@pytest.fixture
def edit(parent: Path) -> Dataset:
    """An edit beside its parent in the cache."""
    return filter_dataset(Dataset.open(parent), parent.parent / EDIT, id=EDIT, split="train")


def lose(dataset: Dataset) -> dict[str, bytes | str]:
    """Deletes all but the `recipe.json`; returns what was in the files."""
    before = contents(dataset.path)
    shutil.rmtree(dataset.path / "data.zarr")
    for name in ("manifest.json", "card.md"):
        (dataset.path / name).unlink()
    return before


@pytest.mark.parametrize("by_id", [True, *slow(False)])
def test_load_makes_a_lost_edit_again(edit: Dataset, by_id: bool) -> None:
    before = lose(edit)
    again = load(EDIT if by_id else edit.path, progress=False)
    assert (again.source, again.digest) == ("rebuilt", edit.digest)
    assert contents(edit.path) == before
    assert load(EDIT).source == "cache"
    assert not [path for path in edit.path.parent.iterdir() if "rebuild" in path.name]


@pytest.mark.slow
def test_the_parents_of_an_edit_are_made_again_too(edit: Dataset, parent: Path) -> None:
    of_edit = filter_dataset(edit, parent.parent / EDIT_OF_EDIT, id=EDIT_OF_EDIT, min_return=-1e9)
    lose(of_edit)
    lose(edit)
    assert load(EDIT_OF_EDIT, progress=False).digest == of_edit.digest
    assert load(EDIT).source == "cache"


@pytest.mark.slow
def test_parents_come_from_remotes(
    edit: Dataset, parent: Path, original: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shelf = Shelf(tmp_path / "shelf", original)
    monkeypatch.setenv("SWARMDATA_REMOTES", shelf.address)
    shutil.rmtree(parent)
    lose(edit)
    with pytest.raises(DatasetNotFoundError, match=f"{EDIT} cannot be made again.*{PARENT}"):
        load(EDIT, offline=True, progress=False)
    assert [path.name for path in edit.path.iterdir()] == ["recipe.json"]
    assert load(EDIT, progress=False).digest == edit.digest


@pytest.mark.slow
def test_another_parent_of_the_same_id_is_refused(edit: Dataset, parent: Path) -> None:
    shutil.rmtree(parent)
    make_tiny(parent, id=PARENT, seed=9)
    lose(edit)
    with pytest.raises(DatasetNotFoundError, match=f"is made from {PARENT} with digest"):
        load(EDIT, progress=False)
    assert [path.name for path in edit.path.iterdir()] == ["recipe.json"]


def test_an_edit_that_is_its_own_ancestor_is_refused(edit: Dataset, parent: Path) -> None:
    """A forged one; waiting for its own lock it would never end."""
    both = combine_datasets([edit], parent.parent / EDIT_OF_EDIT, id=EDIT_OF_EDIT)
    for dataset, ancestor in ((edit, EDIT_OF_EDIT), (both, EDIT)):
        lose(dataset)
        content = json.loads((dataset.path / "recipe.json").read_bytes())
        content["parents"][0]["id"] = ancestor
        (dataset.path / "recipe.json").write_text(json.dumps(content))
    with pytest.raises(SpecError, match="which is made from it"):
        load(EDIT, progress=False)


def test_what_is_left_of_the_arrays_is_for_a_repair(edit: Dataset) -> None:
    (edit.path / "manifest.json").unlink()
    with pytest.raises(MissingManifestError, match=f"verify {edit.path} --repair"):
        load(EDIT)


@pytest.mark.parametrize("file", [*slow("manifest.json"), "data.zarr/states/c.0.0"])
def test_a_repair_makes_the_files_of_an_edit_again(edit: Dataset, file: str) -> None:
    before = (edit.path / file).read_bytes()
    flip(edit.path / file, 40)
    assert [each.how for each in repair(edit.path, progress=False)] == [MADE_AGAIN]
    assert (edit.path / file).read_bytes() == before
    assert examine(edit.path) == ()


def test_an_edit_without_its_origin_cannot_be_made_again(edit: Dataset) -> None:
    flip(edit.path / "recipe.json", 40)
    with pytest.raises(DatasetError, match="is absent, broken or no recipe"):
        repair(edit.path, progress=False)
