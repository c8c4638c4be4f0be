"""Vault: Flashbax reads what we write, and we read what it wrote, OG-MARL's keys included."""

import time
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.interop.convert import import_dataset
from swarmdata.interop.export import export_dataset
from swarmdata.types import END_REASONS
from tests.interop.foreign import timeline

jax = pytest.importorskip("jax", reason="the extra 'vault'")
flashbax_vault = pytest.importorskip("flashbax.vault", reason="the extra 'vault'")

pytestmark = pytest.mark.slow  # importing JAX takes seconds


def test_flashbax_reads_it(recorded: Dataset, tmp_path: Path) -> None:
    export_dataset(recorded, tmp_path / "vaults/tag.vlt/mine", format="vault")
    vault = flashbax_vault.Vault("tag.vlt", rel_dir=str(tmp_path / "vaults"), vault_uid="mine")
    experience = vault.read().experience
    expected, infos = recorded.transitions(), experience["infos"]
    for name in ("observations", "actions", "rewards"):
        np.testing.assert_array_equal(experience[name][0], expected[name])
    np.testing.assert_array_equal(infos["state"][0], expected["states"])
    np.testing.assert_array_equal(infos["next_observations"][0], expected["next_observations"])
    for theirs, ours in (("terminals", "terminations"), ("truncations", "truncations")):
        for agent in range(2):
            np.testing.assert_array_equal(experience[theirs][0, :, agent], expected[ours])


def write_theirs(folder: Path, leaves: dict[str, Any], written: int) -> Path:
    """Writes as OG-MARL does: a trajectory buffer's state through a vault."""
    from flashbax.buffers.trajectory_buffer import TrajectoryBufferState

    vault = flashbax_vault.Vault(
        "3m.vlt", experience_structure=leaves, rel_dir=str(folder), vault_uid="Good"
    )
    state = TrajectoryBufferState(experience=leaves, current_index=written, is_full=False)
    assert vault.write(state) == written
    return folder / "3m.vlt/Good"


def their_leaves(lengths: list[int], cut: list[bool], n_timelines: int = 2) -> dict[str, Any]:
    """Observation and state name timeline, episode and time; a row more than is written."""
    arrays = timeline(lengths, cut)
    seen = arrays["observations"]
    rows = np.stack([np.insert(seen, 0, k, axis=1) for k in range(n_timelines)])  # [B, T, 3]
    observations = np.repeat(rows[:, :, None], 3, axis=2)
    observations[:, :, 2, 2] = -np.inf  # OMAR's padding of smaller agents

    def of_agents(values: Any) -> Any:
        return np.broadcast_to(values[None, :, None], (n_timelines, len(values), 3))

    legals = np.ones((n_timelines, len(seen), 3, 6), np.float32)
    leaves: dict[str, Any] = {
        "observations": observations,
        "actions": of_agents(seen[:, 1].astype(np.int32) % 4),
        "rewards": of_agents(seen[:, 1]),
        "terminals": of_agents(arrays["terminals"]),
        "truncations": of_agents(arrays["timeouts"]),
        "infos": {"state": rows, "legals": legals},
    }
    return jax.tree.map(lambda x: np.concatenate([x, x[:, -1:]], 1), leaves)


def take_in(path: Path, **answers: Any) -> Dataset:
    out = path.parents[2] / "out"
    return import_dataset(path, out, format="vault", id="smac_3m-good-v0", **answers)


def test_theirs_is_cut_at_ends_of_all_agents(tmp_path: Path) -> None:
    lengths, cut = [3, 5, 2, 4] * 4, [False, True, False, True] * 4
    path = write_theirs(tmp_path / "v", their_leaves(lengths, cut), sum(lengths))
    with pytest.raises(ConversionError, match="lacks the observation after the last action"):
        take_in(path)
    dataset = take_in(path, final="cut")
    kept = [n - is_cut for n, is_cut in zip(lengths, cut, strict=True)]
    assert dataset.episodes.lengths.tolist() == kept * 2, "both timelines, one after the other"
    assert dataset.spec.agents[0].action.n == 6  # type: ignore[attr-defined]
    for index, episode in enumerate(dataset):
        t = np.arange(len(episode))
        timeline, number = divmod(index, len(lengths))
        assert (episode.observations[:, 0, 0] == timeline).all()
        assert (episode.observations[:, 0, 1] == number).all()
        np.testing.assert_array_equal(episode.observations[:-1, 0, 2], t)
        np.testing.assert_array_equal(episode.rewards[:, 1], t)
        np.testing.assert_array_equal(episode.actions[:, 1, 0], t % 4)
        assert not episode.observations[:, 2, 2].any(), "padding is zero"
        assert END_REASONS[episode.end_reason] == ("horizon" if cut[number] else "ended")
        assert episode.action_masks is not None
        assert episode.action_masks.shape == (len(t) + 1, 3, 6)


def test_another_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    with pytest.raises(ConversionError, match="not the folder of a vault's uid"):
        import_dataset(tmp_path / "x", tmp_path / "out", format="vault", id="smac_3m-good-v0")


def test_a_failed_export_waits_for_threads_that_still_write(
    recorded: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They would make the temporary folder again after it was removed."""
    threads: list[Thread] = []

    def go_on(folder: Path) -> None:
        for k in range(8):
            folder.mkdir(parents=True, exist_ok=True)
            (folder / str(k)).write_bytes(b"x")
            time.sleep(0.02)

    def fail(*_: Any, **__: Any) -> None:
        (folder,) = tmp_path.rglob("mine")
        threads.append(Thread(target=go_on, args=[folder]))
        threads[0].start()
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(flashbax_vault.Vault, "write", fail)
    with pytest.raises(OSError, match="Input/output"):
        export_dataset(recorded, tmp_path / "mine", format="vault")
    threads[0].join()
    assert list(tmp_path.iterdir()) == []
