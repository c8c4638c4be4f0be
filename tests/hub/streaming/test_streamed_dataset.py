"""Streaming from a web server: what is fetched, checked and kept, and which batches come of it."""

import itertools
import pickle
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmdata
from swarmdata.datasets import reobservation
from swarmdata.datasets.dataset import Dataset
from swarmdata.datasets.mixture import Mixture
from swarmdata.errors import ChecksumError, HubError, SchemaError, SpecError
from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.interface import Release
from swarmdata.hub.streaming import episode_blocks, remote_arrays
from swarmdata.hub.streaming.streamed_dataset import Stream, StreamedDataset, open_stream
from swarmdata.hub.streaming.window_sampler import WindowSampler
from swarmdata.store.arrays import layout
from swarmdata.testing.synthetic import RELEASE_CARD, make_dataset, write_release
from swarmdata.types import Batch
from tests.hub.remotes.faults import Fault
from tests.hub.remotes.static_host import StaticHost
from tests.support.pairs import slow
from tests.support.tiny import flip

ID = "coop_nav-synthetic-v0"
OTHER_ID = "coop_nav-other-v0"
LENGTHS = [[30, 10, 70, 40, 20, 55, 5, 60, 25, 35, 80, 15, 45, 50, 65]]  # 605 joint steps
WEIGHTS = [3, 1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A published folder with a dataset of 38 chunks in each array over time, and a smaller one."""
    root = tmp_path_factory.mktemp("published")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(layout, "CHUNK_ROWS", 16)
        make_dataset(root / ID, LENGTHS, block=3)
        write_release(root / OTHER_ID, LENGTHS[0][:6], OTHER_ID)
    for name in (ID, OTHER_ID):
        (root / name / "card.md").write_text(RELEASE_CARD)
    return root


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(episode_blocks, "BLOCK_STEPS", 60)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1,localhost")


@pytest.fixture
def host(folder: Path) -> Iterator[StaticHost]:
    with StaticHost(folder) as server:
        yield server


@pytest.fixture
def whole(folder: Path) -> Dataset:
    return Dataset.open(folder / ID)


def stream(host: StaticHost, **changes: Any) -> StreamedDataset:
    return swarmdata.load(f"{host.url}/{ID}", stream=Stream(**changes))


def mixed(host: StaticHost, window: int) -> Mixture:
    names = [f"{host.url}/{name}" for name in (ID, OTHER_ID)]
    return swarmdata.load(names, stream=Stream(window=window), weights=WEIGHTS)


def mixed_whole(folder: Path) -> Mixture:
    return swarmdata.load([folder / name for name in (ID, OTHER_ID)], weights=WEIGHTS)


def assert_same(one: Batch, other: Batch) -> None:
    for field in fields(Batch):
        values, expected = getattr(one, field.name), getattr(other, field.name)
        assert np.array_equal(values, expected), field.name


def test_only_the_index_is_fetched_first(host: StaticHost, whole: Dataset) -> None:
    data = stream(host)
    arrays = {line.split("data.zarr/")[1] for line in host.log if "data.zarr" in line}
    assert {name.split("/")[0] for name in arrays} == {"episodes"}
    assert (data.id, data.digest, data.spec) == (whole.id, whole.digest, whole.spec)
    assert (len(data), data.n_steps) == (len(whole), whole.n_steps)
    assert np.array_equal(data.moments.observation_mean, whole.moments.observation_mean)
    for name, column in whole.episodes.columns().items():
        assert np.array_equal(data.episodes.columns()[name], column), name
    assert "15 episodes, 605 steps" in repr(data)


SIZES = [{"horizon": 8, "burn_in": 3}, *slow({}, {"horizon": 7})]
"""Of batches: single steps, sequences with and without a burn-in."""


@pytest.mark.parametrize("sizes", SIZES)
def test_a_window_of_all_blocks_gives_the_batches_of_the_whole(
    host: StaticHost, whole: Dataset, sizes: dict[str, int]
) -> None:
    sampler = stream(host, window=100).split("train").sampler(32, seed=5, **sizes)
    expected = whole.split("train").sampler(32, seed=5, **sizes)
    for _ in range(20):
        assert_same(next(sampler), next(expected))


def test_only_the_wanted_fields_are_read(host: StaticHost, whole: Dataset) -> None:
    index = np.arange(8)
    some = stream(host, window=3).sampler(8).gather(index, {"actions"})
    np.testing.assert_array_equal(some.actions, whole.sampler(8).gather(index).actions)
    assert some.observations is None


@pytest.mark.slow
def test_a_moving_window_gives_rows_of_the_selected_episodes(
    host: StaticHost, whole: Dataset
) -> None:
    view, train = stream(host, window=3).split("train"), whole.split("train")
    sampler, reader = view.sampler(16, seed=2), train.sampler(16)
    drawn = []
    for _ in range(200):
        index = sampler.draw()
        assert_same(sampler.gather(index), reader.gather(index))
        drawn.append(index)
    counts = np.bincount(np.concatenate(drawn), minlength=whole.n_steps)
    inside = np.zeros(whole.n_steps, np.bool_)
    inside[reader.rows.valid] = True
    assert not counts[~inside].any()
    assert (counts[inside] > 0).mean() > 0.9  # several passes
    assert len(sampler._memory._slots) <= 5  # three blocks, the next, and one of the last


def test_a_window_holds_what_is_near_in_the_order_of_a_pass(host: StaticHost) -> None:
    sampler = stream(host, window=2).sampler(16)
    blocks = sampler._blocks
    n_blocks = len(blocks.firsts) - 1
    assert n_blocks == 10
    order = [sampler._block_at(k) for k in range(3 * n_blocks)]
    assert sorted(order[:10]) == sorted(order[10:20]) == list(range(10))
    assert order[:10] != order[10:20]
    for turn in range(20):
        rows = sampler._find_valid_rows(turn)
        found = np.unique(np.searchsorted(blocks.first_steps, rows, side="right") - 1)
        assert set(found.tolist()) == {order[turn], order[turn + 1]}


@pytest.mark.slow
@pytest.mark.parametrize("sizes", SIZES)
def test_streams_are_mixed_as_whole_datasets_are(
    host: StaticHost, folder: Path, sizes: dict[str, int]
) -> None:
    streamed, whole = mixed(host, window=100), mixed_whole(folder)
    assert (streamed.id, streamed.view, streamed.spec) == (whole.id, whole.view, whole.spec)
    assert streamed.make_env(2, n_threads=1).spec == whole.spec.world
    sampler = streamed.split("train").sampler(32, seed=5, **sizes)
    expected = whole.split("train").sampler(32, seed=5, **sizes)
    for _ in range(20):
        assert_same(next(sampler), next(expected))


@pytest.mark.slow
def test_windows_of_mixed_streams_move_with_the_rows_of_their_part(
    host: StaticHost, folder: Path
) -> None:
    streamed, reader = mixed(host, window=1), mixed_whole(folder).sampler(16)
    sampler, drawn = streamed.sampler(16, seed=2), []
    for _ in range(200):
        state, index = sampler.state_dict(), sampler.draw()
        assert_same(sampler.gather(index), reader.gather(index))
        drawn.append(index)
    n_first = streamed.parts[0].n_steps
    shares = np.concatenate(drawn) < n_first
    assert shares.mean() == pytest.approx(0.75, abs=0.03)
    first, second = sampler._samplers
    assert isinstance(first, WindowSampler)
    assert isinstance(second, WindowSampler)
    for part, share in ((first, 0.75), (second, 0.25)):
        n_before = 199 * 16 * share  # rows of the part that were drawn before the last batch
        assert part._turn == n_before // (16 * part._turn_batches) > 10
    again = streamed.sampler(16, seed=2)
    again.load_state_dict(state)
    np.testing.assert_array_equal(again.draw(), drawn[-1])
    with pytest.raises(SchemaError, match="window_0"):
        mixed(host, window=3).sampler(16, seed=2).load_state_dict(state)


@pytest.mark.slow
def test_samplers_of_several_seeds_share_a_window(host: StaticHost, whole: Dataset) -> None:
    data = stream(host, window=2)
    first, second = data.sampler(8, seed=0), data.sampler(8, seed=1)
    for _ in range(30):
        index = np.stack([first.draw(), second.draw()])
        assert_same(first.gather(index), whole.sampler(8).gather(index))


def test_a_stream_goes_on_where_it_was(host: StaticHost) -> None:
    data = stream(host, window=2)
    sampler = data.sampler(16, seed=3)
    for _ in range(17):
        sampler.draw()
    state = sampler.state_dict()
    again = data.sampler(16, seed=3)
    again.load_state_dict(state)
    assert_same(next(again), next(sampler))
    with pytest.raises(SchemaError, match="resume with"):
        stream(host, window=3).sampler(16, seed=3).load_state_dict(state)


def test_episodes_are_the_recorded_ones_and_are_fetched_as_looked_at(
    host: StaticHost, whole: Dataset
) -> None:
    data = stream(host)
    for ours, theirs in zip(data.read("rewards"), whole.read("rewards"), strict=True):
        assert np.array_equal(ours[0], theirs[0])
    assert not any("observations" in line for line in host.log)
    assert [each.team_return for each in data] == [each.team_return for each in whole]
    for name in type(whole[3]).__slots__:
        assert np.array_equal(getattr(data[3], name), getattr(whole[3], name)), name
    assert len(next(iter(data))) == 30
    with pytest.raises(IndexError):
        data[15]


@pytest.mark.slow
def test_a_failing_remote_is_named_and_nothing_half_written_stays(
    host: StaticHost, whole: Dataset, cache_folder: Path
) -> None:
    data = stream(host, window=100)
    host.faults = [Fault("observations", status=403, skip=5)]
    with pytest.raises(HubError, match=r"being streamed, and chunk \d+ of .*observations.*403"):
        next(data.sampler(64, seed=1))
    kept = [path for path in cache_folder.rglob("*") if path.is_file()]
    assert {path.suffix for path in kept} == {".chunk"}
    host.faults = []
    assert_same(next(data.sampler(64, seed=1)), next(whole.sampler(64, seed=1)))


def test_wrong_bytes_are_fetched_again_once(
    host: StaticHost, whole: Dataset, cache_folder: Path
) -> None:
    data = stream(host, window=100)
    host.faults = [Fault("states", corrupt=True, times=1)]
    assert_same(next(data.sampler(64)), next(whole.sampler(64)))
    host.faults = [Fault("states", corrupt=True)]
    other = stream(host, window=100, cache_bytes=0)
    with pytest.raises(ChecksumError, match=r"wrong bytes of chunk \d+ .* twice"):
        next(other.sampler(64))


@pytest.mark.slow
def test_chunks_are_kept_and_checked_again(
    host: StaticHost, whole: Dataset, cache_folder: Path
) -> None:
    next(stream(host, window=100).sampler(64))
    host.log.clear()
    next(stream(host, window=100).sampler(64))
    assert not any("observations" in line for line in host.log)
    chunk = sorted(cache_folder.rglob("observations/*.chunk"))[0]
    flip(chunk, 9)
    assert_same(next(stream(host, window=100).sampler(64)), next(whole.sampler(64)))
    assert sum("observations" in line for line in host.log) == 1


def test_recorded_states_are_observed_again_block_by_block(tiny: Path, tmp_path: Path) -> None:
    models = "lidar-8+noise-0.05", "lossy-30+range-1.5"
    whole = Dataset.open(tiny).reobserve(*models, progress=False)
    data = swarmdata.load(tiny, stream=Stream(window=2), observation=models[0],
                          communication=models[1])  # fmt: skip
    assert (data.spec, data.view) == (whole.spec, whole.view)
    sampler, reader = data.sampler(16), whole.sampler(16)
    for _ in range(30):
        index = sampler.draw()
        assert_same(sampler.gather(index), reader.gather(index))
    assert np.array_equal(data[2].delivered, whole[2].delivered)
    found, exact = data.moments, whole.moments  # all blocks are measured
    np.testing.assert_allclose(found.observation_mean, exact.observation_mean, rtol=1e-6)


def test_a_block_is_observed_again_once_for_all_arrays_and_for_all_moments(
    tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    observe, observed = reobservation.observe_episodes, list[Any]()

    def counted(*arguments: Any, **options: Any) -> dict[str, Any]:
        observed.append(arguments)
        return observe(*arguments, **options)

    monkeypatch.setattr(episode_blocks, "observe_episodes", counted)
    data = swarmdata.load(tiny, stream=True, observation="lidar-8", communication="lossy-30")
    n_blocks = len(data.blocks.firsts) - 1
    assert all(len(episode.ages) == len(episode.observations) for episode in data)
    assert len(observed) == n_blocks > 1
    observed.clear()
    assert data.split("train").moments.observation_mean is data.moments.observation_mean
    assert len(observed) <= n_blocks


def test_recorded_observations_are_not_fetched_to_observe_again(tiny: Path, tmp_path: Path) -> None:
    FolderRemote(tmp_path.as_uri())
    published = tmp_path / "coop_nav-tiny-v0"
    published.symlink_to(tiny)
    with StaticHost(tmp_path) as host:
        data = swarmdata.load(f"{host.url}/coop_nav-tiny-v0", stream=True, observation="lidar-8")
        next(data.sampler(16))
        assert any("states" in line for line in host.log)
        assert not any("observations" in line for line in host.log)


@pytest.mark.slow
def test_training_is_that_of_the_whole_dataset(
    host: StaticHost, whole: Dataset, tmp_path: Path
) -> None:
    pytest.importorskip("torch")
    from swarmdata.learn.training.settings import override
    from swarmdata.learn.training.trainer import Schedule, train_seeds
    from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve

    config = override(
        resolve("algorithm", OFFLINE_ALGORITHMS, "bc").Config(),
        {"n_updates": "6", "batch_size": "16", "hidden": "8,8"},
    )
    schedule = Schedule(checkpoint_every=6, log_every=3)
    for name, data in (("a", whole), ("b", stream(host, window=100))):
        train_seeds(
            "bc", data.split("train"), tmp_path / name, seeds=range(2), config=config,
            schedule=schedule, progress=False,
        )  # fmt: skip
    one, two = (next((tmp_path / name).rglob("losses*")).read_text() for name in "ab")
    assert one == two


def test_servers_and_remotes_of_whole_files_are_refused(folder: Path, tmp_path: Path) -> None:
    with StaticHost(folder, ranges=False) as host, pytest.raises(HubError, match="whole files"):
        stream(host)

    class Whole:
        address = "own://place"

    with pytest.raises(HubError, match="has no `read_range`"):
        open_stream(Whole(), Release(ID, "own://place/x"), Stream(), lambda manifest: None)  # type: ignore[arg-type]


def test_what_a_stream_cannot_have_is_refused(folder: Path) -> None:
    for arguments in ({"verify": "full"}, {"workers": 2}, {"rewards": "safe"}):
        with pytest.raises(SpecError, match=f"stream does not go with {next(iter(arguments))}"):
            swarmdata.load(folder / ID, stream=True, **arguments)
    with pytest.raises(SpecError, match="with the one dataset"):
        swarmdata.load(folder / ID, stream=True, weights=[1.0])  # type: ignore[call-overload]
    with pytest.raises(SpecError, match="window of at least 1"):
        Stream(window=0)
    with pytest.raises(HubError, match="not on this machine, and no remote has it"):
        swarmdata.load("coop_nav-medium-mini", stream=True)


def test_a_dataset_of_this_machine_is_not_copied(folder: Path, cache_folder: Path) -> None:
    data = swarmdata.load(folder / ID, stream=True)
    assert isinstance(data.sampler(), WindowSampler)
    next(data.sampler(8))
    assert not list(cache_folder.rglob("*.chunk"))
    assert remote_arrays.RemoteArrays.__name__ in repr(type(data.blocks.source))


@pytest.mark.slow
@pytest.mark.parametrize("n_workers", [2, *slow(0)])
def test_the_workers_of_a_loader_stream_for_themselves(host: StaticHost, n_workers: int) -> None:
    loading = pytest.importorskip("torch.utils.data", reason="a DataLoader is torch's")
    data = stream(host, window=3)
    expected = list(itertools.islice(data.sampler(8, seed=2), 5))  # opens connections of its own
    context = "fork" if n_workers else None  # blocks are small in workers, too
    loader = loading.DataLoader(
        data.to_torch(8, seed=2),
        batch_size=None,
        num_workers=n_workers,
        multiprocessing_context=context,
    )
    for got, batch in zip(loader, expected, strict=False):
        assert np.array_equal(got.observations.numpy(), batch.observations)


def test_a_slice_is_a_view(host: StaticHost) -> None:
    data = stream(host)
    view = data[2:5]
    assert (type(view), len(view)) == (StreamedDataset, 3)
    assert np.array_equal(view[0].states, data[2].states)
    with pytest.raises(SchemaError, match="expected the number of an episode or a slice"):
        data["a"]  # type: ignore[call-overload]
    assert len(repr(view)) <= 300


@pytest.mark.slow
def test_a_stream_travels_by_its_address(host: StaticHost) -> None:
    view = stream(host, window=3).filter(split="train")
    content = pickle.dumps(view)
    again = pickle.loads(content)
    assert len(content) < 50_000  # of which the manifest has most
    assert repr(again) == repr(view)
    sampler = view.sampler(8)
    next(sampler)
    assert_same(next(pickle.loads(pickle.dumps(sampler))), next(sampler))
    assert_same(next(again.sampler(8)), next(view.sampler(8)))
