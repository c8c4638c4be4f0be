"""One content in the formats of peers: how it is written, and how all of it is loaded into arrays.

Rows are joint steps; the last observation and state of each episode, which only ours and Minari
keep, are left out elsewhere. Minari has one reward per step, so it gets the team's.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.dataset import Dataset
from swarmdata.store.stored_dataset import Verify

Arrays = dict[str, NDArray[Any]]

STEPS = ("actions", "log_probs", "rewards", "terminations", "truncations", "events")
STATES = ("observations", "states")
MINARI_ID = "bench/load-v0"
OURS, MINARI = "ours", "minari"


@dataclass(frozen=True)
class Format:
    file: str  # name of its file or folder
    packages: tuple[str, ...]  # what it needs beside ours
    write: Callable[[Dataset, Path], None]  # makes it from our dataset
    load: Callable[[Path], object]  # returns everything in memory, or mapped
    note: str  # for the table


def steps_of(dataset: Dataset) -> Arrays:
    """Every field with one row per joint step."""
    table, stored = dataset.stored.table, dataset.stored.arrays
    rows = np.arange(dataset.n_steps)
    rows += np.repeat(np.arange(len(table)), table.lengths)  # skips each episode's last state
    return {**{n: stored[n] for n in STEPS}, **{n: stored[n].take(rows, axis=0) for n in STATES}}


def write_npz(dataset: Dataset, path: Path) -> None:
    np.savez(path, **steps_of(dataset))  # type: ignore[arg-type]


def load_npz(path: Path) -> object:
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


def write_hdf5(dataset: Dataset, path: Path) -> None:
    """As D4RL's files: flat, gzip, chunks of 1,000 rows."""
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in steps_of(dataset).items():
            chunks = (min(1000, len(values)), *values.shape[1:])
            file.create_dataset(name, data=values, compression="gzip", chunks=chunks)


def load_hdf5(path: Path) -> object:
    import h5py

    with h5py.File(path, "r") as file:
        return {name: file[name][:] for name in file}


def write_vault(dataset: Dataset, path: Path) -> None:
    """As OG-MARL's files; one row more than is written, since a full buffer writes nothing."""
    import jax
    import jax.numpy as jnp
    from flashbax.buffers.trajectory_buffer import TrajectoryBufferState
    from flashbax.vault import Vault

    experience = {
        name: jnp.asarray(np.concatenate([values, values[:1]])[None])
        for name, values in steps_of(dataset).items()
    }
    state = TrajectoryBufferState(
        experience=experience,
        current_index=jnp.asarray(dataset.n_steps),
        is_full=jnp.asarray(False),
    )
    structure = jax.tree.map(
        lambda values: jax.ShapeDtypeStruct(values.shape, values.dtype), experience
    )
    vault = Vault("bench.vlt", structure, rel_dir=str(path), vault_uid="Good")
    assert vault.write(state) == dataset.n_steps


def load_vault(path: Path) -> object:
    import jax
    from flashbax.vault import Vault

    vault = Vault("bench.vlt", rel_dir=str(path), vault_uid="Good")
    experience: object = jax.tree.map(np.asarray, vault.read().experience)
    return experience


def write_minari(dataset: Dataset, path: Path) -> None:
    import warnings

    import gymnasium
    import minari
    from minari.data_collector import EpisodeBuffer

    def space(values: NDArray[Any]) -> Any:
        return gymnasium.spaces.Box(-np.inf, np.inf, values.shape[1:], np.float32)

    buffers = [
        EpisodeBuffer(
            id=index, seed=index, observations=episode.observations, actions=episode.actions,
            rewards=episode.rewards.mean(1), terminations=episode.terminations,
            truncations=episode.truncations,
            infos={"state": episode.states},
        )
        for index, episode in enumerate(dataset)
    ]  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of an author, a permalink: none of a benchmark
        minari.create_dataset_from_buffers(
            MINARI_ID, buffers,
            observation_space=space(dataset[0].observations),
            action_space=space(dataset[0].actions),
        )  # fmt: skip


def load_minari(path: Path) -> object:
    """Its `load_dataset` reads nothing but metadata: the episodes are iterated."""
    import minari

    return list(minari.load_dataset(MINARI_ID).iterate_episodes())


def no_write(dataset: Dataset, path: Path) -> None:
    """Ours is there already."""


def load_copy(path: Path) -> object:
    dataset = Dataset.open(path, "fast")
    return {name: values.copy() for name, values in dataset.stored.arrays.items()}


LEVELS: dict[Verify, str] = {
    "none": "sizes and metadata",
    "fast": "every chunk's xxh3",
    "full": "both SHA-256 digests",
}

FORMATS = {
    **{
        f"swarmdata, verify={level!r}": Format(
            OURS, (), no_write, partial(Dataset.open, verify=level), f"mapped; {checked}"
        )
        for level, checked in LEVELS.items()
    },
    "swarmdata, 'fast', copied": Format(
        OURS, (), no_write, load_copy, "in memory; every chunk's xxh3"
    ),
    "npz": Format("bench.npz", (), write_npz, load_npz, "in memory; CRC-32"),
    "HDF5, gzip, as D4RL": Format(
        "d4rl.hdf5", ("h5py",), write_hdf5, load_hdf5, "in memory; no checksum"
    ),
    "Vault of OG-MARL": Format(
        "vaults", ("flashbax", "jax"), write_vault, load_vault, "in memory; no checksum"
    ),
    "Minari, HDF5": Format(
        MINARI, ("minari", "h5py", "gymnasium"), write_minari, load_minari, "in memory; no checksum"
    ),
}
"""By name in the table."""
