"""TorchRL: its replay buffers sample what we write, and we read what they stored."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmdata
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, SchemaError
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.export import export_dataset
from tests.interop.foreign import check_timeline, timeline

pytest.importorskip("torchrl", reason="the extra 'torchrl'")
torch = pytest.importorskip("torch", reason="the extra 'torch'")

pytestmark = pytest.mark.slow  # importing TorchRL takes seconds


def test_keys_are_those_of_multi_agent_environments(ours: Dataset, tmp_path: Path) -> None:
    from tensordict import TensorDict

    rows = TensorDict.load_memmap(str(export_dataset(ours, tmp_path / "x", format="torchrl")))
    expected = ours.transitions()
    assert tuple(rows.batch_size) == (ours.n_steps,)
    pairs = {
        ("agents", "observation"): expected["observations"],
        ("next", "agents", "observation"): expected["next_observations"],
        ("agents", "action"): expected["actions"],
        ("next", "agents", "reward"): expected["rewards"][..., None],
        ("next", "terminated"): expected["terminations"][:, None],
        ("next", "truncated"): expected["truncations"][:, None],
        ("next", "done"): (expected["terminations"] | expected["truncations"])[:, None],
        ("state",): expected["states"],
        ("next", "state"): expected["next_states"],
        ("collector", "traj_ids"): expected["episodes"],
    }
    for key, values in pairs.items():
        np.testing.assert_array_equal(rows[key].numpy(), values, err_msg=str(key))


def test_slices_of_a_buffer_stay_in_one_episode(ours: Dataset, tmp_path: Path) -> None:
    from tensordict import TensorDict
    from torchrl.data import LazyMemmapStorage, SliceSampler, TensorDictReplayBuffer

    from swarmdata.interop.torchrl.torchrl import replay_buffer

    path = export_dataset(ours, tmp_path / "x", format="torchrl")
    copied = TensorDictReplayBuffer(
        storage=LazyMemmapStorage(ours.n_steps, scratch_dir=str(tmp_path / "scratch")),
        sampler=SliceSampler(slice_len=2, traj_key=("collector", "traj_ids")),
        batch_size=32,
    )
    copied.extend(TensorDict.load_memmap(str(path)))
    for buffer in (copied, replay_buffer(path, 32, slice_length=2)):
        sample = buffer.sample().reshape(16, 2)
        seen = sample["agents", "observation"][:, :, 0]
        assert (seen[:, 0, 0] == seen[:, 1, 0]).all(), "one episode"
        assert (seen[:, 0, 1] + 1 == seen[:, 1, 1]).all(), "consecutive steps"
        after = sample["next", "agents", "observation"][:, 0, 0]
        assert (after == seen[:, 1]).all(), "what was reached is seen next"
    assert replay_buffer(path, 7).sample().batch_size == torch.Size([7])


def test_a_view_is_a_buffer_without_files(ours: Dataset) -> None:
    view = ours.filter(success=False) if len(ours.filter(success=False)) > 0 else ours
    expected = view.transitions()
    buffer = view.replay_buffer(16)

    rows = buffer[:]
    for key, name in {
        ("agents", "observation"): "observations",
        ("agents", "action"): "actions",
        ("next", "agents", "observation"): "next_observations",
        ("next", "state"): "next_states",
        ("collector", "traj_ids"): "episodes",
    }.items():
        np.testing.assert_array_equal(rows[key].numpy(), expected[name], err_msg=str(key))
    sample = view.replay_buffer(16, slice_length=2).sample().reshape(8, 2)
    numbers = sample["collector", "traj_ids"]
    assert (numbers[:, 0] == numbers[:, 1]).all(), "slices stay in one episode"


def test_an_empty_view_is_refused(ours: Dataset) -> None:
    with pytest.raises(SchemaError, match="has no episodes to sample from"):
        ours.filter(min_return=1e9).replay_buffer()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # TorchRL's own, when it is imported
def test_datasets_are_a_source_of_load_dataset(ours: Dataset) -> None:
    from torchrl.data.datasets import load_dataset

    swarmdata.register_torchrl()
    swarmdata.register_torchrl()  # again does no harm
    buffer = load_dataset(f"swarmdata:{ours.path}", batch_size=5)

    assert len(buffer) == ours.split("train").n_steps
    assert buffer.sample().batch_size == torch.Size([5])


def their_rows(lengths: list[int], cut: list[bool], n_agents: int = 2) -> Any:
    """A `timeline` as a collector of two groups gives it."""
    from tensordict import TensorDict

    arrays = {name: torch.from_numpy(each) for name, each in timeline(lengths, cut).items()}
    episode, time = arrays["observations"].T.long()

    def of_agents(rows: Any) -> Any:
        return rows[:, None].repeat(1, n_agents, 1)

    def seen(name: str, columns: int) -> Any:
        return of_agents(torch.nn.functional.pad(arrays[name], (0, columns - 2)))

    def group(columns: int) -> dict[str, Any]:
        return {"observation": seen("observations", columns), "action": of_agents(time[:, None])}

    def after(columns: int) -> dict[str, Any]:
        reward = of_agents(arrays["rewards"][:, None])
        return {"observation": seen("next_observations", columns), "reward": reward}

    flags = {"terminated": arrays["terminals"][:, None], "truncated": arrays["timeouts"][:, None]}
    reached = {"adversary": after(2), "agent": after(3), **flags}
    groups = {"adversary": group(2), "agent": group(3)}
    collected = {**groups, "next": reached, "collector": {"traj_ids": episode}}
    return TensorDict(collected, [len(time)])


def test_theirs_with_groups(tmp_path: Path) -> None:
    lengths, cut = [3, 5, 1, 4] * 7, [False, True] * 14
    their_rows(lengths, cut).memmap(str(tmp_path / "x"))
    dataset = import_dataset(tmp_path / "x", tmp_path / "out", format="torchrl", id="tag-theirs-v0")
    assert dataset.spec.n_agents == 4
    assert dataset[0].observations.shape == (4, 4, 3)
    check_timeline(dataset, lengths, cut)


def test_a_dumped_buffer_of_interleaved_trajectories(tmp_path: Path) -> None:
    """A buffer with room for more rows, filled by several environments in turn."""
    from torchrl.data import LazyMemmapStorage, TensorDictReplayBuffer

    lengths, cut = [4, 6] * 14, [False, True] * 14
    rows = their_rows(lengths, cut)
    halves = torch.cat([torch.arange(n) >= n // 2 for n in lengths])
    parts = [torch.nonzero(~halves)[:, 0], torch.nonzero(halves)[:, 0]]
    buffer = TensorDictReplayBuffer(
        storage=LazyMemmapStorage(1000, scratch_dir=str(tmp_path / "scratch"))
    )
    for part in parts:
        buffer.extend(rows[part])
    buffer.dumps(str(tmp_path / "dumped"))
    dataset = import_dataset(
        tmp_path / "dumped", tmp_path / "out", format="torchrl", id="tag-theirs-v0"
    )
    check_timeline(dataset, lengths, cut)


def test_open_trajectories_are_asked_about(tmp_path: Path) -> None:
    lengths, cut = [3, 5] * 14, [False] * 28
    rows = their_rows(lengths, cut)
    rows["next", "terminated"][2] = False
    rows.memmap(str(tmp_path / "x"))

    def take_in(name: str, **answers: Any) -> Dataset:
        return import_dataset(
            tmp_path / "x", tmp_path / name, format="torchrl", id="tag-theirs-v0",
            **answers,
        )  # fmt: skip

    with pytest.raises(ConversionError, match="1 trajectories without an end, such as number 0"):
        take_in("no")
    check_timeline(take_in("kept", unfinished="truncate"), lengths, [True, *cut[1:]])
    assert len(take_in("dropped", unfinished="drop")) == 27


def test_other_folders_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    with pytest.raises(ConversionError, match="not a memory-mapped TensorDict"):
        import_dataset(tmp_path / "x", tmp_path / "out", format="torchrl", id="tag-b-v0")


def test_a_buffer_of_some_keys(ours: Dataset) -> None:
    keys = (("agents", "action"), "state")
    buffer = ours.replay_buffer(8, keys=keys)
    assert set(buffer.sample().keys(True, True)) == {("agents", "action"), "state"}
    slices = ours.replay_buffer(8, slice_length=2, keys=keys).sample()
    assert ("collector", "traj_ids") in slices.keys(True, True)
    with pytest.raises(SchemaError, match="have no keys"):
        ours.replay_buffer(8, keys=(("agents", "speed"),))


def test_a_pickle_beside_the_tensors_is_never_run(ours: Dataset, tmp_path: Path) -> None:
    """tensordict would load it, in an import and for a buffer."""
    from tensordict import NonTensorData, TensorDict

    from swarmdata.interop.torchrl.torchrl import replay_buffer

    path = export_dataset(ours, tmp_path / "x", format="torchrl")
    TensorDict({"a": NonTensorData(object)}, []).memmap(str(path / "extra"))
    assert list(path.rglob("*.pickle"))
    for read in (
        lambda: replay_buffer(path, 8),
        lambda: import_dataset(path, tmp_path / "out", format="torchrl", id="tag-b-v0"),
    ):
        with pytest.raises(ConversionError, match="is a pickle, which would run as a program"):
            read()
    assert not (tmp_path / "out").exists()
