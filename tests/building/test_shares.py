"""Shares of a dataset's parts: any order, twice, some missing, and the same dataset."""

from pathlib import Path

import pytest

from swarmdata.building.build import build
from swarmdata.building.part_maker import make_part
from swarmdata.building.parts_folder import build_folder
from swarmdata.building.shares import finish_parts, make_share
from swarmdata.errors import BuildError, SpecError
from swarmdata.specs.recipe import Recipe
from swarmdata.store import read_manifest
from tests.building.conftest import SMALL

pytestmark = pytest.mark.usefixtures("one_process")


def test_shares_in_any_order_make_the_dataset(tmp_path: Path, tiny_digest: str) -> None:
    out = tmp_path / "d"
    made = [make_share(SMALL, out, share, 3) for share in (3, 1, 2)]
    assert all(made)
    assert len({name for names in made for name in names}) == sum(map(len, made))
    assert make_share(SMALL, out, 1, 3) == []  # it is there
    assert read_manifest(finish_parts(SMALL, out, progress=False)).digest == tiny_digest
    assert not build_folder(out).exists()
    assert make_share(SMALL, out, 1, 3) == []
    assert finish_parts(SMALL, out) == out


def test_what_shares_leave_out_is_made_at_the_end(tmp_path: Path, tiny_digest: str) -> None:
    out = tmp_path / "d"
    with pytest.raises(BuildError, match=r"has parts of 0 joint steps .* not enough for"):
        finish_parts(SMALL, out)
    make_share(SMALL, out, 2, 2)
    with pytest.raises(BuildError, match="Run all shares to their end; or leave out --finish"):
        finish_parts(SMALL, out)
    assert read_manifest(build(SMALL, out, progress=False)).digest == tiny_digest


def test_a_part_that_comes_too_late_is_removed(
    tmp_path: Path, tiny_digest: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "d"

    def make_late(recipe: Recipe, *arguments: object, **options: object) -> object:
        build(recipe, out, progress=False)
        return make_part(recipe, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr("swarmdata.building.shares.make_part", make_late)
    assert len(make_share(SMALL, out, 1, 2)) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["d"]
    assert read_manifest(out).digest == tiny_digest


@pytest.mark.parametrize("share", [0, 4])
def test_other_shares_are_refused(tmp_path: Path, share: int) -> None:
    with pytest.raises(SpecError, match=f"share {share}/3 does not exist"):
        make_share(SMALL, tmp_path / "d", share, 3)
    assert list(tmp_path.iterdir()) == []
