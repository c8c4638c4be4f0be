"""D4RL-style HDF5: what a plain h5py reader finds, there and back, and what is refused."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.d4rl import read
from swarmdata.interop.export import export_dataset
from swarmdata.interop.formats import find_format
from swarmdata.store.scratch import scratch_folder
from swarmdata.testing.synthetic import make_dataset
from swarmdata.types import END_REASONS
from tests.interop.foreign import NEEDS, WRITERS, TakeIn, check_timeline, hdf5, timeline


def test_rows_are_aligned_and_none_is_missing(ours: Dataset, tmp_path: Path) -> None:
    with h5py.File(export_dataset(ours, tmp_path / "x.hdf5", format="d4rl")) as file:
        found = {name: file[name][()] for name in file if isinstance(file[name], h5py.Dataset)}
    expected = ours.transitions()
    n = ours.n_steps
    assert found["observations"].shape == (n, 30)
    for name in ("observations", "next_observations", "actions"):
        np.testing.assert_array_equal(found[name], expected[name].reshape(n, -1))
    np.testing.assert_array_equal(found["terminals"], expected["terminations"])
    np.testing.assert_array_equal(found["timeouts"], expected["truncations"])
    np.testing.assert_allclose(found["rewards"], expected["rewards"].mean(1), rtol=1e-6)
    # features 0 and 1 are the seed and the time: each action is beside what it answered
    seeds = np.repeat(ours.episodes.seeds, ours.episodes.lengths)
    times = np.concatenate([np.arange(k) for k in ours.episodes.lengths])
    np.testing.assert_array_equal(found["observations"][:, 0], seeds)
    np.testing.assert_array_equal(found["observations"][:, 1], times)
    np.testing.assert_array_equal(found["next_observations"][:, 1], times + 1)


Lengths = st.lists(st.integers(1, 7), min_size=2, max_size=12)


@pytest.mark.parametrize("kind", ["d4rl", "parquet"])
@given(lengths=Lengths, data=st.data())
def test_foreign_files_are_cut_where_their_flags_say(
    tmp_path_factory: pytest.TempPathFactory, kind: str, lengths: list[int], data: st.DataObject
) -> None:
    cut = data.draw(st.lists(st.booleans(), min_size=len(lengths), max_size=len(lengths)))
    path = WRITERS[kind](tmp_path_factory.mktemp(kind) / "x", timeline(lengths, cut))
    read = find_format(kind).read
    assert read is not None
    with read(path, "maze", Choices(time_limit=0)) as incoming:
        episodes = list(incoming.episodes)
    assert [episode.seed for episode in episodes] == list(range(len(lengths)))
    check_timeline(episodes, lengths, cut)


@given(lengths=Lengths, limit=st.integers(1, 8))
def test_a_counted_limit_cuts_what_has_no_flag(
    tmp_path_factory: pytest.TempPathFactory, lengths: list[int], limit: int
) -> None:
    """Without timeouts, an episode ends at its terminal or after `limit` steps."""
    lengths = [min(length, limit) for length in lengths]
    arrays = timeline(lengths, [length == limit for length in lengths])
    del arrays["timeouts"]
    path = hdf5(tmp_path_factory.mktemp("d4rl") / "x.hdf5", arrays)
    with read(path, "maze", Choices(time_limit=limit)) as incoming:
        check_timeline(incoming.episodes, lengths, [length == limit for length in lengths])


def test_the_last_observation_is_asked_for(tmp_path: Path, take_in: TakeIn) -> None:
    lengths, cut = [3, 5] * 15, [False, True] * 15
    arrays = timeline(lengths, cut)
    del arrays["next_observations"]
    path = hdf5(tmp_path / "x.hdf5", arrays)
    with pytest.raises(ConversionError, match="lacks the observation after the last action"):
        take_in(path, "d4rl")
    check_timeline(take_in(path, "d4rl", final="repeat").episodes, lengths, cut, has_next=False)
    shorter = take_in(path, "d4rl", final="cut")
    check_timeline(shorter.episodes, [3, 4] * 15, cut, has_next=False)
    for episode in shorter.episodes:
        if END_REASONS[episode.end_reason] == "horizon":
            assert episode.observations[-1, 0, 1] == len(episode), "a true last observation"
    assert shorter.metadata["final"] == "cut"


def test_a_limit_stored_as_a_termination_is_noticed(tmp_path: Path, take_in: TakeIn) -> None:
    path = hdf5(tmp_path / "x.hdf5", timeline([4] * 25, [False] * 25))
    with pytest.raises(ConversionError, match="as if a time limit had been stored"):
        take_in(path, "d4rl")
    assert set(take_in(path, "d4rl", time_limit=4).ends) == {"horizon"}
    assert set(take_in(path, "d4rl", time_limit=0).ends) == {"ended"}


def test_columns_of_several_agents(tmp_path: Path, take_in: TakeIn) -> None:
    lengths, cut = [3, 4] * 13, [False, True] * 13
    arrays = timeline(lengths, cut)
    for name in ("observations", "next_observations", "actions"):
        arrays[name] = np.concatenate([arrays[name], arrays[name]], 1)
    path = hdf5(tmp_path / "x.hdf5", arrays)
    dataset = take_in(path, "d4rl", n_agents=2)
    assert dataset.spec.n_agents == 2
    assert take_in(path, "d4rl", agents=("anna", "bert")).spec.agent_names == ("anna", "bert")
    assert dataset.episodes[0].observations.shape == (4, 2, 2)
    check_timeline(dataset.episodes, lengths, cut)


def test_a_changed_export_is_refused(ours: Dataset, tmp_path: Path) -> None:
    path = export_dataset(ours, tmp_path / "x.hdf5", format="d4rl")
    with h5py.File(path, "r+") as file:
        file["terminals"][0] = True
    with pytest.raises(ConversionError, match=r"rows 0 to \d+ does not end exactly once"):
        import_dataset(path, tmp_path / "back", format="d4rl", id="tag_v3-back-v0")
    assert not (tmp_path / "back").exists()
    assert not scratch_folder(tmp_path / "back", "conversion").exists()


@pytest.mark.parametrize(
    ("format", "file", "key"),
    [
        ("d4rl", "", "rewards"),
        ("minari", "data/main_data.hdf5", "episode_0/rewards"),
    ],
)
def test_team_rewards_that_were_changed_are_not_ignored(
    ours: Dataset, tmp_path: Path, format: str, file: str, key: str
) -> None:
    pytest.importorskip(NEEDS.get(format, "h5py"), reason=f"the extra of {format}")
    path = export_dataset(ours, tmp_path / ours.id, format=format)
    with h5py.File(path / file, "r+") as opened:
        opened[key][1] += 1.0
    with pytest.raises(ConversionError, match="are not the means of `infos/agent_rewards`"):
        import_dataset(path, tmp_path / "back", format=format, id="tag_v3-back-v0")


def test_other_files_are_refused(ours: Dataset, tmp_path: Path, take_in: TakeIn) -> None:
    text = tmp_path / "text.hdf5"
    text.write_text("no")
    with pytest.raises(ConversionError, match="not an HDF5 file"):
        take_in(text, "d4rl")
    with pytest.raises(ConversionError, match="has no 'actions'"):
        take_in(hdf5(tmp_path / "x.hdf5", {"observations": np.zeros((2, 2))}), "d4rl")
    with pytest.raises(ConversionError, match="exists already"):
        export_dataset(ours, text, format="d4rl")


def test_a_view_without_train_episodes_needs_new_splits(tmp_path: Path) -> None:
    make_dataset(tmp_path / "ours", [[3] * 30], n_steps=90)
    view = Dataset.open(tmp_path / "ours").split("test")
    path = export_dataset(view, tmp_path / "x.hdf5", format="d4rl")
    with pytest.raises(ConversionError, match="Pass splits='new'"):
        import_dataset(path, tmp_path / "back", format="d4rl", id="tag_v3-back-v0")
    back = import_dataset(path, tmp_path / "back", format="d4rl", id="tag_v3-b-v0", splits="new")
    assert len(back.split("train")) > 0
    assert len(back) == len(view) == 6
