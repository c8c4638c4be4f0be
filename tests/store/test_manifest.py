"""What the error of a damaged dataset advises follows from where the dataset comes from."""

import shutil
from pathlib import Path

import pytest

from swarmdata import load
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ChecksumError, DatasetError
from swarmdata.hub.catalog.repair import repair
from swarmdata.runtime.own_components import import_component
from swarmdata.specs.origins import ORIGIN_KINDS
from swarmdata.specs.origins.recording_origin import Recording
from swarmdata.store.arrays.layout import DATA
from tests.support.made_episodes import stored
from tests.support.own_task import make_thrifty
from tests.support.tiny import TINY, flip


def recorded(tiny: Path, out: Path) -> Path:
    """The tiny dataset's episodes as a recording, which nothing makes again."""
    dataset = Dataset.open(tiny)
    origin = Recording(
        id="coop_nav-recorded-v0", spec=TINY.spec, policies=TINY.policies, source="recorder"
    )
    streams = [[each for each in dataset if each.policy == policy] for policy in range(2)]
    return stored(out, origin, streams).path


def advice(folder: Path) -> str:
    """The message about a dataset of which a bit is flipped."""
    flip(folder / DATA / "actions" / "c.0.0.0", 40)
    with pytest.raises(ChecksumError) as caught:
        load(folder)
    assert "delete" not in str(caught.value)
    return str(caught.value)


def test_a_recipe_or_a_remote_replaces_what_is_broken(tiny: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(tiny, tmp_path / TINY.id)
    said = advice(folder)
    assert f"`swarmdata verify {folder} --repair`" in said
    assert "made again" in said


def test_a_recording_is_kept(tiny: Path, tmp_path: Path) -> None:
    folder = recorded(tiny, tmp_path / "coop_nav-recorded-v0")
    said = advice(folder)
    assert "keep the folder" in said
    assert "made again" not in said
    before = sorted(path for path in folder.rglob("*") if path.is_file())
    with pytest.raises(DatasetError, match=r"Nothing makes it again. Take .* from a remote"):
        repair(folder, progress=False)
    assert sorted(path for path in folder.rglob("*") if path.is_file()) == before


@pytest.mark.slow
def test_a_task_of_another_package_has_its_recipe(tmp_path: Path) -> None:
    folder = make_thrifty(tmp_path / "thrifty-tiny-v0")
    said = advice(folder)
    assert "as its recipe says" in said
    assert "it needs task 'thrifty', which is defined by another package: install it" in said
    with pytest.raises(DatasetError, match=r"it needs task 'thrifty'.* \(tests\): install it"):
        repair(folder, progress=False)


@pytest.mark.parametrize("kind", ORIGIN_KINDS)
def test_every_origin_says_whether_it_is_made_again(kind: str) -> None:
    origin = vars(import_component(ORIGIN_KINDS[kind]))
    assert origin["can_rebuild"] == (kind in ("recipe", "edit"))
    assert origin["missing"] is None
