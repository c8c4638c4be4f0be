"""Every reader, fed with generated odd data: a dataset, or one error of ours and nothing else."""

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

from swarmdata.audit import audit
from swarmdata.cards.side_files import damage_of
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SwarmdataError
from swarmdata.interop.conversion.user_choices import Choices
from swarmdata.interop.convert import import_dataset
from swarmdata.store.damage import find_damage

Arrays = dict[str, Any]
NAMES = ("observations", "next_observations", "actions", "rewards", "terminals", "timeouts")
TYPES = ("f4", "f8", "i8", "u1", "u8", "f2", "bool", "c16", "S3")
ODD = (np.nan, np.inf, 1e39, 2.0**40 + 1, -1.0, 7.0, 2.5)

NUMBERS = ("integrity", "shapes", "finite", "padding", "bounds", "ends", "leaving", "card")
"""Checks of an audit that no import may fail; others look for what good data may have."""


@st.composite
def odd_rows(draw: st.DrawFn) -> Arrays:
    """Rows of a team in which up to two things are odd; episodes end in all the known ways."""
    n, n_agents = draw(st.integers(0, 12)), draw(st.integers(1, 3))
    length, rows = draw(st.integers(1, 5)), np.arange(n)
    seen = np.stack([np.stack([rows, np.full(n, k)], 1) for k in range(n_agents)], 1)
    flags = np.repeat((rows % length == length - 1)[:, None], n_agents, 1)
    if draw(st.booleans()):  # every agent has its own
        drawn = draw(st.lists(st.booleans(), min_size=flags.size, max_size=flags.size))
        flags = np.array(drawn, bool).reshape(flags.shape)
    is_cut = draw(st.booleans())
    arrays: Arrays = {
        "observations": seen.astype(np.float32),
        "next_observations": (seen + np.array([1, 0])).astype(np.float32),
        "actions": seen[..., :1] % 3,
        "rewards": rows.astype(np.float32),
        "terminals": flags & ~is_cut,
        "timeouts": flags & is_cut,
    }
    for _ in range(draw(st.integers(0, 2))):
        _spoil(draw, arrays)
    return arrays


def _spoil(draw: st.DrawFn, arrays: Arrays) -> None:
    name = draw(st.sampled_from([name for name in NAMES if name in arrays]))
    values = arrays[name]
    match draw(st.sampled_from(["type", "value", "length", "shape", "absent", "extra"])):
        case "type":
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                arrays[name] = values.astype(draw(st.sampled_from(TYPES)))
        case "value" if values.size and values.dtype.kind != "S":
            wide = values.astype(np.float64 if values.dtype.kind != "c" else values.dtype)
            wide.reshape(-1)[draw(st.integers(0, wide.size - 1))] = draw(st.sampled_from(ODD))
            arrays[name] = wide
        case "length":
            arrays[name] = values[: draw(st.integers(0, len(values)))]
        case "shape":
            arrays[name] = draw(st.sampled_from([
                values.reshape(len(values), -1) if len(values) else values,
                np.stack([values, values], -1), values[..., :0] if values.ndim > 1 else values,
            ]))  # fmt: skip
        case "absent":
            del arrays[name]
        case "extra":
            arrays["costs"] = values


choices = st.builds(
    Choices,
    time_limit=st.sampled_from([None, 0, 1, 3, 5]),
    episode_length=st.sampled_from([None, None, 2, 5]),
    final=st.sampled_from([None, "repeat", "cut"]),
    unfinished=st.sampled_from([None, "truncate", "drop"]),
    n_agents=st.sampled_from([None, None, 1, 2]),
    action_high=st.sampled_from([None, None, 1.0]),
)


def d4rl(folder: Path, arrays: Arrays) -> Path:
    with h5py.File(folder / "x.hdf5", "w") as file:
        for name, values in arrays.items():
            file[name] = values
    return folder / "x.hdf5"


def parquet(folder: Path, arrays: Arrays) -> Path:
    pyarrow = pytest.importorskip("pyarrow", reason="the extra 'parquet'")
    pq = pytest.importorskip("pyarrow.parquet", reason="the extra 'parquet'")
    names = {"terminals": "terminations", "timeouts": "truncations"}
    most = max([len(values) for values in arrays.values()], default=0)
    columns = {}
    for name, values in arrays.items():
        given = np.abs(values) if values.dtype.kind == "c" else values
        listed = given.tolist() + [None] * (most - len(given))
        columns[names.get(name, name)] = pyarrow.array(listed)
    pq.write_table(pyarrow.table(columns), folder / "x.parquet")
    return folder / "x.parquet"


def numpy_folder(folder: Path, arrays: Arrays) -> Path:
    path = folder / "x"
    path.mkdir()
    names = {"observations": "obs", "next_observations": "next_obs", "actions": "acs",
             "rewards": "rews", "terminals": "dones"}  # fmt: skip
    for ours, theirs in names.items():
        if ours not in arrays:
            continue
        values: Any = arrays[ours]
        for k in range(2):
            is_team = values.ndim > 1 and values.size
            own = values[:, min(k, values.shape[1] - 1)] if is_team else values
            np.save(path / f"{theirs}_{k}.npy", own)
    return path


def minari_folder(folder: Path, arrays: Arrays) -> Path:
    """Episodes of one agent, in the groups that Minari writes."""
    minari = pytest.importorskip("minari", reason="the extra 'minari'")
    from gymnasium.spaces import Box, Discrete
    from minari.serialization import serialize_space

    path = folder / "x"
    path.mkdir()
    meta = {
        "observation_space": serialize_space(Box(-np.inf, np.inf, (2,), np.float32)),
        "action_space": serialize_space(Discrete(3)), "data_format": "hdf5",
        "total_episodes": 2, "total_steps": 0, "dataset_id": "maze/x-v0",
        "minari_version": minari.__version__,
    }  # fmt: skip
    (path / "metadata.json").write_text(json.dumps(meta))
    names = {"terminals": "terminations", "timeouts": "truncations"}
    with h5py.File(path / "main_data.hdf5", "w") as file:
        for number in range(2):
            group = file.create_group(f"episode_{number}")
            group.attrs["total_steps"] = len(arrays.get("rewards", ()))
            for name, values in arrays.items():
                own = values[:, 0] if values.ndim > 1 and values.shape[1] else values
                if name == "observations" and "next_observations" in arrays and len(own):
                    after = arrays["next_observations"]
                    own = np.concatenate([own, own[-1:]]) if len(after) else own
                group[names.get(name, name)] = own
    return path


def torchrl(folder: Path, arrays: Arrays) -> Path:
    torch = pytest.importorskip("torch", reason="the extra 'torch'")
    tensordict = pytest.importorskip("tensordict", reason="the extra 'torchrl'")
    keys = {
        "observations": ("agents", "observation"), "actions": ("agents", "action"),
        "next_observations": ("next", "agents", "observation"),
        "rewards": ("next", "agents", "reward"), "terminals": ("next", "agents", "terminated"),
        "timeouts": ("next", "agents", "truncated"), "costs": ("costs",),
    }  # fmt: skip
    n = min([len(values) for values in arrays.values()], default=0)
    rows = tensordict.TensorDict({}, [n])
    for name, values in arrays.items():
        if values.dtype.kind in "biuf" and values.dtype != np.uint64:
            rows[keys[name]] = torch.from_numpy(np.ascontiguousarray(values[:n]))
    rows.memmap(str(folder / "x"))
    return folder / "x"


def vault(folder: Path, arrays: Arrays) -> Path:
    flashbax_vault = pytest.importorskip("flashbax.vault", reason="the extra 'vault'")
    from flashbax.buffers.trajectory_buffer import TrajectoryBufferState

    names = {"timeouts": "truncations"}
    rewards: Any = arrays.get("rewards", np.zeros(()))
    if rewards.ndim == 1 and np.ndim(arrays.get("terminals", ())) == 2:
        arrays["rewards"] = np.repeat(rewards[:, None], arrays["terminals"].shape[1], 1)
    n = min([len(values) for values in arrays.values()], default=0)
    leaves = {
        names.get(name, name): _narrow(np.concatenate([values[:n], values[:1]])[None])
        for name, values in arrays.items()
        if values.dtype.kind in "bif" and name != "next_observations" and values.size
    }
    if not leaves or not n:
        return folder
    made = flashbax_vault.Vault(
        "x.vlt", experience_structure=leaves, rel_dir=str(folder), vault_uid="u"
    )
    made.write(TrajectoryBufferState(experience=leaves, current_index=n, is_full=False))
    return folder / "x.vlt/u"


def _narrow(values: Any) -> Any:
    """As JAX has numbers: at most 32 bits."""
    if values.dtype.itemsize <= 4:
        return values
    with np.errstate(all="ignore"):
        return values.astype(np.int32 if values.dtype.kind == "i" else np.float32)


def check(source: Path, out: Path, kind: str, answers: Choices) -> None:
    try:
        dataset = import_dataset(source, out, format=kind, id="maze-x-v0", choices=answers)
    except SwarmdataError as error:
        event(f"{kind}: {type(error).__name__}")
        assert {path.name for path in out.parent.iterdir()} <= {".out.lock"}
        return
    event(f"{kind}: a dataset")
    assert {path.name for path in out.parent.iterdir()} <= {".out.lock", "out"}
    assert not find_damage(out)
    assert not damage_of(out)
    assert Dataset.open(out, "full").digest == dataset.digest
    found = audit(out, progress=False).problems
    assert not [each for each in found if each.check in NUMBERS]


ODDLY = settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)  # each makes files, and some a dataset


def run(tmp: pytest.TempPathFactory, write: Callable[..., Path], kind: str, *given: Any) -> None:
    arrays, answers = given
    folder = tmp.mktemp("odd")
    (folder / "in").mkdir()
    (folder / "to").mkdir()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the libraries', of odd data
        source = write(folder / "in", arrays)
    check(source, folder / "to" / "out", kind, answers)


@ODDLY
@given(arrays=odd_rows(), answers=choices)
@pytest.mark.parametrize(
    ("kind", "write"),
    [("d4rl", d4rl), ("parquet", parquet), ("numpy", numpy_folder), ("minari", minari_folder)],
)
def test_odd_data_give_a_dataset_or_one_error(
    tmp_path_factory: pytest.TempPathFactory,
    kind: str,
    write: Callable[..., Path],
    arrays: Arrays,
    answers: Choices,
) -> None:
    run(tmp_path_factory, write, kind, arrays, answers)


@pytest.mark.slow  # importing TorchRL and JAX takes seconds
@ODDLY
@given(arrays=odd_rows(), answers=choices)
@pytest.mark.parametrize(("kind", "write"), [("torchrl", torchrl), ("vault", vault)])
def test_odd_data_of_slow_libraries(
    tmp_path_factory: pytest.TempPathFactory,
    kind: str,
    write: Callable[..., Path],
    arrays: Arrays,
    answers: Choices,
) -> None:
    run(tmp_path_factory, write, kind, arrays, answers)
