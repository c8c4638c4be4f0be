"""Views and samplers on their way to other processes: small, mapped, and the same."""

import multiprocessing
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest

from swarmdata.datasets import pickled_views
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.mixture import mix
from swarmdata.datasets.reweighting import Relabeling
from swarmdata.errors import ChecksumError, SchemaError
from swarmdata.runtime.mapped_pages import mapping_of
from swarmdata.store.arrays.scratch_arrays import ScratchMap, map_shared, share
from tests.support.own_rewards import effort
from tests.support.tiny import make_tiny

VIEWS = {
    "recorded": lambda data: data,
    "selected": lambda data: data.split("train"),
    "observed": lambda data: data.reobserve("lidar-8", "lossy-30", progress=False)[1:],
    "rewarded": lambda data: data.with_rewards(robot_collision=2.0),
    "relabeled": lambda data: data.with_rewards(effort),
    "both": lambda data: data.with_rewards(time=0.5).reobserve("lidar-8", progress=False),
}


@pytest.fixture(params=VIEWS)
def view(request: pytest.FixtureRequest, tiny: Path) -> Dataset:
    found: Dataset = VIEWS[request.param](Dataset.open(tiny, verify="none"))
    return found


def assert_same(again: Dataset, view: Dataset) -> None:
    assert repr(again) == repr(view)
    assert again.view == view.view
    assert again.references == view.references
    np.testing.assert_array_equal(again.selection, view.selection)
    np.testing.assert_array_equal(again.moments.observation_std, view.moments.observation_std)
    assert again.moments.reward_mean == view.moments.reward_mean
    np.testing.assert_array_equal(again.episodes.team_return, view.episodes.team_return)
    for name, array in view.stored.arrays.items():
        np.testing.assert_array_equal(again.stored.arrays[name], array)
        assert not (array.size and again.stored.arrays[name].flags.writeable)


def test_a_view_pickles_without_its_arrays(view: Dataset) -> None:
    content = pickle.dumps(view)
    assert len(content) < 10_000
    again = pickle.loads(content)
    assert_same(again, view)
    for array in again.stored.computed().values():
        assert array.size < 1000 or isinstance(mapping_of(array), ScratchMap)
    assert_same(pickle.loads(pickle.dumps(again)), view)


def test_computed_arrays_are_computed_again_where_they_are_gone(
    view: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = pickle.dumps(view)
    monkeypatch.setattr(pickled_views, "map_shared", lambda shared: None)
    if isinstance(view.reweighting, Relabeling):
        with pytest.raises(SchemaError, match="function effort in another process"):
            pickle.loads(content)
    else:
        assert_same(pickle.loads(content), view)


def test_where_an_array_was_is_nothing_else(tiny: Path) -> None:
    seen = Dataset.open(tiny, verify="none").reobserve("lidar-8", progress=False)
    found = share(seen.stored.arrays["observations"])
    assert found is not None
    device, inode = found.file
    other = found._replace(file=(device, inode + 1))
    assert map_shared(found) is not None
    assert map_shared(other) is None
    assert map_shared(found._replace(path="/proc/0/fd/0")) is None


def test_a_sampler_pickles_as_its_view_and_goes_on(view: Dataset) -> None:
    sampler = view.sampler(8, horizon=4, burn_in=2, seed=5)
    next(sampler)
    content = pickle.dumps(sampler)
    assert len(content) < 10_000
    again = pickle.loads(content)
    assert again.state_dict() == sampler.state_dict()
    np.testing.assert_array_equal(next(again).observations, next(sampler).observations)


def test_a_mixture_pickles_by_its_parts(view: Dataset) -> None:
    mixture = mix([view, view[:2]], [0.3, 0.7])
    sampler = mixture.sampler(8, seed=1)
    for each in (mixture, sampler):
        assert len(pickle.dumps(each)) < 20_000
    again = pickle.loads(pickle.dumps(sampler))
    np.testing.assert_array_equal(next(again).actions, next(sampler).actions)


def test_a_replaced_dataset_is_refused(tmp_path: Path, tiny: Path) -> None:
    place = Path(shutil.copytree(tiny, tmp_path / tiny.name))
    content = pickle.dumps(Dataset.open(place, verify="none").with_rewards(time=0.5))
    place.rename(tmp_path / "old")
    make_tiny(place, seed=7)
    with pytest.raises(ChecksumError, match="replaced meanwhile"):
        pickle.loads(content)


def _first_sums(view: Dataset) -> tuple[float, bool]:
    seen = view.stored.arrays["observations"]
    return float(seen.sum(dtype=np.float64)), isinstance(mapping_of(seen), ScratchMap)


@pytest.mark.slow
def test_a_spawned_process_maps_a_reobservation(tiny: Path) -> None:
    """Row 33: it does not receive the arrays, and does not compute them again."""
    seen = Dataset.open(tiny, verify="none").reobserve("lidar-8", progress=False)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(_first_sums, (seen,)) == _first_sums(seen)
