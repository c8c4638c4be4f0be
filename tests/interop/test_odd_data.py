"""Every reader, fed with generated odd data: a dataset, or one error of ours and nothing else."""

import json
import warnings
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
from tests.interop.foreign import WRITERS, Arrays, team
from tests.support.pairs import slow

NAMES = ("observations", "next_observations", "actions", "rewards", "terminals", "timeouts")
TYPES = ("f4", "f8", "i8", "u1", "u8", "f2", "bool", "c16", "S3")
ODD = (np.nan, np.inf, 1e39, 2.0**40 + 1, -1.0, 7.0, 2.5)

NUMBERS = ("integrity", "shapes", "finite", "padding", "bounds", "ends", "leaving", "card")
"""Checks of an audit that no import may fail; others look for what good data may have."""


@st.composite
def odd_rows(draw: st.DrawFn) -> Arrays:
    """Rows of a team in which up to two things are odd; episodes end in all the known ways."""
    n, n_agents = draw(st.integers(0, 12)), draw(st.integers(1, 3))
    arrays = team(n, n_agents, draw(st.integers(1, 5)))
    flags = arrays["timeouts"]
    if draw(st.booleans()):  # every agent has its own
        drawn = draw(st.lists(st.booleans(), min_size=flags.size, max_size=flags.size))
        flags = np.array(drawn, bool).reshape(flags.shape)
    is_cut = np.bool_(draw(st.booleans()))
    arrays |= {"terminals": flags & ~is_cut, "timeouts": flags & is_cut}
    arrays["actions"] = arrays["observations"][..., :1].astype(int) % 3
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


def check(source: Path, out: Path, kind: str, answers: Choices) -> None:
    try:
        dataset = import_dataset(source, out, format=kind, id="maze-x-v0", **vars(answers))
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


def minari_folder(path: Path, arrays: Arrays) -> Path:
    """Two episodes of one agent, in the groups that Minari writes."""
    minari = pytest.importorskip("minari", reason="the extra 'minari'")
    from gymnasium.spaces import Box, Discrete
    from minari.serialization import serialize_space

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
                if name == "observations" and len(arrays.get("next_observations", ())):
                    own = np.concatenate([own, own[-1:]])
                group[names.get(name, name)] = own
    return path


def torchrl(path: Path, arrays: Arrays) -> Path:
    torch = pytest.importorskip("torch", reason="the extra 'torch'")
    tensordict = pytest.importorskip("tensordict", reason="the extra 'torchrl'")
    keys = {
        "observations": ("agents", "observation"), "actions": ("agents", "action"),
        "next_observations": ("next", "agents", "observation"),
        "rewards": ("next", "agents", "reward"), "terminals": ("next", "agents", "terminated"),
        "timeouts": ("next", "agents", "truncated"), "costs": ("costs",),
    }  # fmt: skip
    n = min((len(values) for values in arrays.values()), default=0)
    rows = tensordict.TensorDict({}, [n])
    for name, values in arrays.items():
        if values.dtype.kind in "biuf" and values.dtype != np.uint64:
            rows[keys[name]] = torch.from_numpy(np.ascontiguousarray(values[:n]))
    rows.memmap(str(path))
    return path


def vault(path: Path, arrays: Arrays) -> Path:
    flashbax_vault = pytest.importorskip("flashbax.vault", reason="the extra 'vault'")
    from flashbax.buffers.trajectory_buffer import TrajectoryBufferState

    rewards: Any = arrays.get("rewards", np.zeros(()))
    if rewards.ndim == 1 and np.ndim(arrays.get("terminals", ())) == 2:
        arrays["rewards"] = np.repeat(rewards[:, None], arrays["terminals"].shape[1], 1)
    n = min((len(values) for values in arrays.values()), default=0)
    leaves = {
        "truncations" if name == "timeouts" else name: _narrow(
            np.concatenate([values[:n], values[:1]])[None]
        )
        for name, values in arrays.items()
        if values.dtype.kind in "bif" and name != "next_observations" and values.size
    }
    if leaves and n:
        made = flashbax_vault.Vault(
            "x.vlt", experience_structure=leaves, rel_dir=str(path), vault_uid="u"
        )
        made.write(TrajectoryBufferState(experience=leaves, current_index=n, is_full=False))
        return path / "x.vlt/u"
    path.mkdir()
    return path


def _narrow(values: Any) -> Any:
    """As JAX has numbers: at most 32 bits."""
    if values.dtype.itemsize <= 4:
        return values
    with np.errstate(all="ignore"):
        return values.astype(np.int32 if values.dtype.kind == "i" else np.float32)


KINDS = {**WRITERS, "minari": minari_folder, "torchrl": torchrl, "vault": vault}


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(arrays=odd_rows(), answers=choices)
@pytest.mark.parametrize(
    "kind", ["d4rl", *slow(*(k for k in WRITERS if k != "d4rl"), "minari", "torchrl", "vault")]
)
def test_odd_data_give_a_dataset_or_one_error(
    tmp_path_factory: pytest.TempPathFactory, kind: str, arrays: Arrays, answers: Choices
) -> None:
    folder = tmp_path_factory.mktemp("odd")
    (folder / "to").mkdir()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the libraries', of odd data
        source = KINDS[kind](folder / "in", arrays)
    check(source, folder / "to" / "out", kind, answers)
