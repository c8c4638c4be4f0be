"""`swarmdata filter`, `combine` and `subsample`: new datasets in the cache, or where one says."""

from pathlib import Path

import pytest

from swarmdata.building.edit import filter_dataset
from swarmdata.datasets.dataset import Dataset
from swarmdata.specs.origins.edit_origin import Edit
from swarmdata.testing.synthetic import make_dataset
from tests.support.command_line import run


@pytest.fixture
def source(tmp_path: Path) -> Path:
    make_dataset(
        tmp_path / "source", [[3, 1, 7, 4, 2, 9, 1, 6], [5, 5, 1, 8, 1, 1, 3, 2]], n_steps=30
    )
    return tmp_path / "source"


def test_filter_combine_and_subsample(source: Path, cache_folder: Path, tmp_path: Path) -> None:
    said = run("filter", str(source), "--id", "coop_nav-few-v0", "--policy", "tag-0")
    few = Dataset.open(cache_folder / "datasets/coop_nav-few-v0")
    assert (
        said == f"{few.path}\n{len(few)} episodes, {few.n_steps} joint steps, digest {few.digest}\n"
    )
    rest = tmp_path / "rest"
    run("filter", str(source), "--id", "coop_nav-rest-v0", "--policy", "tag-1", "--out", str(rest))
    run("combine", "coop_nav-few-v0", str(rest), "--id", "coop_nav-all-v0", "--tier", "mine")
    whole = Dataset.open(cache_folder / "datasets/coop_nav-all-v0")
    assert len(whole) == len(Dataset.open(source))
    assert whole.recipe.tier == "mine"
    run("subsample", "coop_nav-all-v0", "--id", "coop_nav-half-v0", "--steps", "15", "--seed", "4")
    half = Dataset.open(cache_folder / "datasets/coop_nav-half-v0")
    assert isinstance(half.recipe, Edit)
    assert half.recipe.operation == "subsample(n_steps=15, seed=4)"
    assert half.recipe.parents[0].digest == whole.digest
    run("subsample", str(source), "--id", "coop_nav-like-v0", "--like", str(source), "--bins", "2")


def test_options_reach_the_library(source: Path, cache_folder: Path, tmp_path: Path) -> None:
    run(
        "filter", str(source), "--id", "coop_nav-some-v0", "--no-success", "--min-return", "-9",
        "--episode", "0", "--episode", "1", "--episode", "2", "--episode", "3",
    )  # fmt: skip
    expected = filter_dataset(
        Dataset.open(source), tmp_path / "same", id="coop_nav-some-v0", success=False,
        min_return=-9.0, episodes=[0, 1, 2, 3],
    )  # fmt: skip
    made = Dataset.open(cache_folder / "datasets/coop_nav-some-v0")
    assert (made.digest, made.recipe) == (expected.digest, expected.recipe)
