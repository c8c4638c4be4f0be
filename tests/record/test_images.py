"""Images of bytes stay bytes: in the store, in views and batches, in edits, and for algorithms."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from swarmdata.audit import audit
from swarmdata.building.edit import combine_datasets, filter_dataset, subsample_dataset
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.mixture import mix
from swarmdata.errors import ManifestError, SchemaError
from swarmdata.record import Recorder, evaluate_parallel, foreign_evaluation_seeds
from swarmdata.store import open_store
from swarmdata.store.arrays.running_moments import RunningMoments
from swarmdata.store.assembly import assemble
from swarmdata.store.parts import write_part
from swarmdata.testing.dataset_contract import check_dataset
from tests.record.worlds import Choosing, Seeing, play, record, spec_of

ID = "seeing_v0-mine-v0"


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return record(Seeing(), tmp_path_factory.mktemp("images") / "ds")


@pytest.fixture(scope="module")
def floats(images: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The same recording as an older version made it."""
    return rewritten(images, tmp_path_factory.mktemp("floats"), ("observations", "states"))


def rewritten(
    images: Dataset, folder: Path, names: tuple[str, ...], dtype: Any = np.float32
) -> Dataset:
    episodes = [
        replace(each, **{name: getattr(each, name).astype(dtype) for name in names})
        for each in images
    ]
    write_part(folder / "part", episodes)
    order = [(0, k) for k in range(len(episodes))]
    assemble(folder / "ds", recipe=images.recipe, parts={0: [folder / "part"]}, order=order)
    return Dataset.open(folder / "ds")


def test_what_passed_is_what_is_stored(images: Dataset) -> None:
    for name in ("observations", "states"):
        assert images.stored.arrays[name].dtype == np.uint8
        assert images.stored.manifest.arrays[name].dtype == "uint8"
        array: Any = zarr.open_array(images.path / "data.zarr" / name, mode="r")
        assert array.dtype == np.uint8
    assert images.stored.manifest.format_version == 1
    for episode in images:
        left = episode.observations[:, 0].reshape(6, 4, 3, 3)
        assert left[:, 0, 0].tolist() == [[50 * t, 0, 255] for t in range(6)]
        assert (left[:, 1:] == episode.seed % 200).all()
        assert (episode.observations[:, 1, 18:] == 0).all(), "padding"
        np.testing.assert_array_equal(episode.states[:, :36], episode.observations[:, 0])
        assert episode.actions.dtype == np.float32
    open_store(images.path, "full")


def test_it_is_a_quarter_of_the_same_data_as_floats(images: Dataset, floats: Dataset) -> None:
    for name in ("observations", "states"):
        one, other = (each.stored.arrays[name] for each in (images, floats))
        assert other.dtype == np.float32
        assert other.nbytes == 4 * one.nbytes
        np.testing.assert_array_equal(one, other)
    for name in ("observation_mean", "observation_std", "reward_mean"):
        np.testing.assert_array_equal(
            getattr(images.statistics, name), getattr(floats.statistics, name)
        )


def test_moments_of_bytes_do_not_depend_on_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = np.random.default_rng(0).integers(0, 256, (500, 7)).astype(np.uint8)
    whole, cut = RunningMoments(), RunningMoments()
    whole.add(rows.astype(np.float32))
    monkeypatch.setattr("swarmdata.store.arrays.running_moments.BLOCK_NUMBERS", 30)
    cut.add(rows)
    assert whole.result() == cut.result()


def test_batches_are_bytes(images: Dataset, floats: Dataset) -> None:
    for options in ({}, {"horizon": 3}, {"horizon": 3, "burn_in": 2}):
        one, other = (next(each.sampler(16, seed=1, **options)) for each in (images, floats))
        for name in ("observations", "next_observations", "states", "next_states"):
            assert getattr(one, name).dtype == np.uint8
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert images.transitions()["next_observations"].dtype == np.uint8
    mixed = next(mix([images, images.split("train")]).sampler(8))
    assert mixed.observations.dtype == np.uint8
    both = next(mix([images, floats]).sampler(64, seed=3))
    assert both.observations.dtype == np.float32
    assert both.observations.max() == 255


def test_states_are_bytes_where_the_environments_are(tmp_path: Path) -> None:
    for dtype, expected in ((np.uint8, np.uint8), (np.float64, np.float32)):
        made = record(Seeing(state=dtype), tmp_path / np.dtype(dtype).name, 6)
        assert made.stored.arrays["states"].dtype == expected
        assert made[0].states[:, 0].tolist() == [0, 40, 80, 120, 160, 200]


def test_other_spaces_stay_floats(tmp_path: Path) -> None:
    """An image beside a number: one array has one dtype."""
    dataset = record(Choosing(), tmp_path / "ds", 5)
    assert dataset.stored.arrays["observations"].dtype == np.float32


@pytest.mark.parametrize("wrong", [256.0, -1.0, 0.5])
def test_numbers_that_are_no_bytes_are_refused(wrong: float, tmp_path: Path) -> None:
    with pytest.raises(SchemaError, match="observation of left has numbers that are not whole"):
        record(Seeing(wrong=wrong), tmp_path / "ds", 1)


def test_a_recording_that_an_older_version_began_is_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its parts are floats; the whole is float32, with the same values."""
    with monkeypatch.context() as patch:
        patch.setattr("swarmdata.record.agent_reader.holds_bytes", lambda space: False)
        first = Recorder(Seeing(), id=ID, path=tmp_path / "ds")
        play(first, 5)
        first.pause()
    dataset = record(Seeing(), tmp_path / "ds", 5)
    assert len(dataset) == 10
    assert dataset.stored.arrays["observations"].dtype == np.float32
    assert {episode.observations.max() for episode in dataset} == {255.0}


@pytest.mark.slow
def test_edits_keep_bytes(images: Dataset, tmp_path: Path) -> None:
    made = [
        filter_dataset(images, tmp_path / "f", id="seeing_v0-f-v0", min_return=-9),
        subsample_dataset(images, tmp_path / "s", id="seeing_v0-s-v0", n_steps=40),
    ]
    for each in made:
        assert each.stored.arrays["observations"].dtype == np.uint8
        open_store(each.path, "full")
    others = record(Seeing(), tmp_path / "others", seed=99)
    (tmp_path / "floats").mkdir()
    older = rewritten(others, tmp_path / "floats", ("observations", "states"))
    both = combine_datasets([images, older], tmp_path / "c", id="seeing_v0-c-v0")
    assert both.stored.arrays["observations"].dtype == np.float32
    open_store(both.path, "full")


def test_the_audit_passes_and_the_contract_holds(images: Dataset) -> None:
    assert audit(images.path, progress=False).problems == ()
    check_dataset(images.path)


def test_a_task_has_no_images(tiny: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Who writes a task's observations as bytes is refused when they are opened."""
    dataset = Dataset.open(tiny)
    own = dataset.filter(policy=dataset.recipe.policies[0].label)
    with pytest.raises(ManifestError, match="observations are uint8, but a task observes no image"):
        rewritten(own, tmp_path, ("observations",), np.uint8)


@pytest.mark.parametrize("name", ["maddpg_bc", "iql"])
def test_algorithms_learn_the_same_from_bytes(
    name: str, images: Dataset, floats: Dataset, tmp_path: Path
) -> None:
    pytest.importorskip("torch", reason="algorithms need torch")
    from swarmdata.learn.training.run_folder import load_run
    from swarmdata.learn.training.trainer import train_seeds
    from tests.learn.training.test_trainer import config_of

    losses = []
    for kind, data in (("bytes", images), ("floats", floats)):
        run = tmp_path / kind
        config = config_of(name, n_updates=8)
        train_seeds(name, data, run, seeds=(0, 1), config=config, progress=False)
        losses.append((run / "losses.csv").read_text())
        seeds = foreign_evaluation_seeds(2)
        result = evaluate_parallel(load_run(run)[0], Seeing, spec_of(data), seeds)
        losses.append(str(result.metrics["return"].tolist()))
    assert losses[:2] == losses[2:]


def test_pages_show_them(images: Dataset, floats: Dataset) -> None:
    from swarmdata.catalogue.replays.series_columns import SeriesColumns

    one, other = (SeriesColumns(d.spec, list(d)) for d in (images, floats))
    assert one.describe() == other.describe()
    np.testing.assert_array_equal(one.moving(images[0]), other.moving(floats[0]))
