"""Every way a stored dataset can be damaged ends in one named error that says what to do."""

import json
import math
import os
import resource
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xxhash
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swarmdata.errors import (
    ChecksumError,
    DatasetError,
    DatasetNotFoundError,
    ManifestError,
    MissingFileError,
    MissingManifestError,
    TruncatedFileError,
)
from swarmdata.store import open_store, read_manifest
from swarmdata.store.arrays.layout import FIELDS, array_file, metadata_file
from swarmdata.store.arrays.shards import file_digest
from swarmdata.store.damage import find_damage
from swarmdata.store.manifest import Manifest
from swarmdata.testing.synthetic import make_dataset
from tests.support.tiny import sign

FILES = [
    *(array_file(name, len(field.dimensions)) for name, field in FIELDS.items()),
    *(metadata_file(name) for name in FIELDS),
    "data.zarr/zarr.json",
    "data.zarr/episodes/zarr.json",
    "recipe.json",
    "manifest.json",
]


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("faults") / "ds"
    make_dataset(path, [[3, 1, 7, 4, 2, 9, 1, 6], [5, 5, 1, 8, 1, 1, 3, 2]], n_steps=30)
    open_store(path, "full")
    return path


@pytest.fixture
def dataset(intact: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(intact, tmp_path / "ds"))


def list_again(path: Path, name: str) -> None:
    """Signs a changed file as if it had been written that way."""
    content = json.loads((path / "manifest.json").read_bytes())
    content["files"][name] = {
        "size": (path / name).stat().st_size,
        "sha256": file_digest(path / name),
    }
    for array, entry in content["arrays"].items():
        if array_file(array, len(entry["shape"])) == name:
            size = Manifest.model_validate(content).arrays[array].shard.chunk_bytes
            chunk = (path / name).read_bytes()[:size]
            entry["checksums"] = [xxhash.xxh3_64_hexdigest(chunk)]
    sign(path, content)


@contextmanager
def refused(dataset: Path, name: str, verify: Any, expected: Any, advice: str) -> Iterator[bytes]:
    """Gives a file's content, to damage it; then the dataset is refused, and the file put back."""
    file = dataset / name
    content = file.read_bytes()
    yield content
    with pytest.raises(expected) as caught:
        open_store(dataset, verify)
    assert str(file) in str(caught.value), name
    assert advice in str(caught.value), name
    file.write_bytes(content)


def test_missing_file(dataset: Path) -> None:
    for name in FILES:
        expected = MissingManifestError if name == "manifest.json" else MissingFileError
        with refused(dataset, name, "none", expected, "--repair"):
            (dataset / name).unlink()


@pytest.mark.parametrize(
    "change", [lambda old: b"", lambda old: old[:-1], lambda old: old + b"more"]
)
def test_a_file_of_another_length(dataset: Path, change: Callable[[bytes], bytes]) -> None:
    for name in FILES:
        changed: Any = (ManifestError, ChecksumError)
        expected = changed if name == "manifest.json" else TruncatedFileError
        with refused(dataset, name, "none", expected, "") as content:
            (dataset / name).write_bytes(change(content))


def test_swapped_files(dataset: Path) -> None:
    first, second = (dataset / array_file(n, 1) for n in ("terminations", "truncations"))
    one, two = first.read_bytes(), second.read_bytes()
    assert one != two
    first.write_bytes(two)
    second.write_bytes(one)
    with pytest.raises(ChecksumError):
        open_store(dataset)


@pytest.mark.parametrize("name", ["recipe.json", "card.md", "manifest.json", "data.zarr"])
def test_symbolic_link(dataset: Path, tmp_path: Path, name: str) -> None:
    target = tmp_path / "elsewhere"
    if (dataset / name).exists():
        (dataset / name).rename(target)
    else:
        target.write_text("secret")
    (dataset / name).symlink_to(target)
    with pytest.raises(ManifestError, match="symbolic link"):
        open_store(dataset)


def test_a_folder_of_links_as_a_hub_cache_has_it(dataset: Path, tmp_path: Path) -> None:
    """It is refused with the way to download files, by whatever reads a dataset."""
    for file in [each for each in dataset.rglob("*") if each.is_file()]:
        blob = tmp_path / "blobs" / "-".join(file.relative_to(dataset).parts)
        blob.parent.mkdir(exist_ok=True)
        file.rename(blob)
        file.symlink_to(blob)
    with pytest.raises(ManifestError, match=r"snapshot_download\(\.\.\., local_dir=FOLDER\)"):
        open_store(dataset)
    with pytest.raises(DatasetNotFoundError, match="local_dir=FOLDER"):
        find_damage(dataset)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"garbage",
        b"[]",
        b"null",
        b"{}",
        b'{"format_version": "1"}',
        b'{"format_version": 0}',
        b'{"format_version": 1, "format_version": 1}',
        b"[" * 100_000,
        b"\xff\xfe",
        b'{"format_version": NaN}',
    ],
    ids=repr,
)
def test_garbage_manifest(dataset: Path, content: bytes) -> None:
    (dataset / "manifest.json").write_bytes(content)
    with pytest.raises(ManifestError, match="--repair"):
        open_store(dataset)


def test_huge_manifest_is_not_read(dataset: Path) -> None:
    os.truncate(dataset / "manifest.json", 1 << 40)
    with pytest.raises(ManifestError, match="more than"):
        open_store(dataset)


def test_newer_keys_of_the_same_format_are_read(dataset: Path) -> None:
    content = json.loads((dataset / "manifest.json").read_bytes())
    sign(dataset, {**content, "license": "CC-BY-4.0"})
    assert open_store(dataset, "full").manifest == read_manifest(dataset)


def _copy(table: dict[str, Any], name: str, other: str) -> None:
    table[other] = table[name]


def _set_array(name: str, key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda content: content["arrays"][name].__setitem__(key, value)


@pytest.mark.parametrize(
    "change",
    [
        _set_array("observations", "shape", [10**15, 2, 5]),
        _set_array("actions", "shape", [10**15, 10**15, 10**15]),
        _set_array("actions", "shape", [-1, 2, 2]),
        _set_array("actions", "dtype", "object"),
        _set_array("actions", "dtype", "float64"),
        _set_array("actions", "chunk_rows", 0),
        _set_array("actions", "chunk_rows", 1),
        _set_array("actions", "checksums", []),
        _set_array("states", "shape", [3]),
        _set_array("observations", "chunk_rows", 10**15),
        lambda content: content["files"].pop("recipe.json"),
        lambda content: _copy(content["files"], "recipe.json", "../../etc/passwd"),
        lambda content: content["arrays"].pop("events"),
        lambda content: _copy(content["arrays"], "events", "../../outside"),
        lambda content: content.update(n_steps=content["n_steps"] - 1),
        lambda content: content["files"][array_file("rewards", 2)].update(size=1),
        lambda content: content.update(recipe_hash="0" * 64),
        lambda content: content["statistics"].update(reward_std=math.nan),
    ],
)
def test_signed_manifest_that_lies(dataset: Path, change: Callable[[dict[str, Any]], None]) -> None:
    content = json.loads((dataset / "manifest.json").read_bytes())
    change(content)
    sign(dataset, content)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ManifestError, match="--repair"):
        open_store(dataset, "none")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # kB


@pytest.mark.parametrize(
    ("column", "index", "value", "problem"),
    [
        ("lengths", 0, 10**6, "end where"),
        ("lengths", 0, 0, "no steps"),
        ("lengths", 1, -5, "no steps"),
        ("starts", 1, 0, "without gaps"),
        ("split", 0, 3, "split"),
        ("end_reason", 0, 77, "end reason"),
        ("policy", 0, 2, "policy"),
    ],
)
def test_signed_episode_table_that_lies(
    dataset: Path, column: str, index: int, value: int, problem: str
) -> None:
    name = array_file(f"episodes/{column}", 1)
    dtype = np.dtype(FIELDS[f"episodes/{column}"].dtype)
    content = bytearray((dataset / name).read_bytes())
    content[index * dtype.itemsize : (index + 1) * dtype.itemsize] = dtype.type(value).tobytes()
    (dataset / name).write_bytes(content)
    list_again(dataset, name)
    with pytest.raises(ManifestError, match=problem):
        open_store(dataset, "fast")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("shape", [10**15, 2, 2]),
        ("zarr_format", 2),
        ("data_type", "int32"),
        ("data_type", "variable_length_bytes"),
        ("codecs", [{"name": "bytes"}, {"name": "zstd"}]),
        ("codecs", [{"name": "numcodecs.pickle", "configuration": {}}]),
    ],
)
def test_signed_zarr_metadata_that_lies(dataset: Path, key: str, value: Any) -> None:
    """Nothing is ever decompressed, so there is no bomb; nor unpickled."""
    name = metadata_file("actions")
    content = json.loads((dataset / name).read_bytes())
    (dataset / name).write_text(json.dumps({**content, key: value}))
    list_again(dataset, name)
    with pytest.raises(ManifestError, match=key):
        open_store(dataset, "fast")


def test_signed_recipe_of_another_dataset(dataset: Path) -> None:
    content = json.loads((dataset / "recipe.json").read_bytes())
    (dataset / "recipe.json").write_text(json.dumps({**content, "seed": 9}))
    list_again(dataset, "recipe.json")
    with pytest.raises(ManifestError, match="another dataset"):
        open_store(dataset)


def test_only_full_sees_a_wrong_logical_digest(dataset: Path) -> None:
    content = json.loads((dataset / "manifest.json").read_bytes())
    sign(dataset, {**content, "digest": "0" * 64})
    open_store(dataset, "fast")
    with pytest.raises(ChecksumError, match="logical digest"):
        open_store(dataset, "full")


def test_unknown_verification_is_refused(dataset: Path) -> None:
    with pytest.raises(ValueError, match="'quick'"):
        open_store(dataset, "quick")  # type: ignore[arg-type]


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_fuzzed_manifest_bytes(intact: Path, dataset: Path, data: st.DataObject) -> None:
    original = (intact / "manifest.json").read_bytes()
    content = bytearray(original)
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    if content == original:
        return
    (dataset / "manifest.json").write_bytes(content)
    with pytest.raises(DatasetError):
        open_store(dataset, "none")


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), value=json_values)
def test_fuzzed_and_signed_manifest(
    intact: Path, dataset: Path, data: st.DataObject, value: Any
) -> None:
    """A signed manifest of wrong types is refused by name; nothing else may be raised."""
    content = json.loads((intact / "manifest.json").read_bytes())
    key = data.draw(st.sampled_from(["arrays", "files", "statistics", "n_steps", "n_episodes"]))
    holder = content
    while isinstance(holder[key], dict) and data.draw(st.booleans()):
        holder = holder[key]
        key = data.draw(st.sampled_from(sorted(holder)))
    if holder[key] == value or isinstance(value, float | int):
        value = "wrong"
    holder[key] = value
    sign(dataset, content)
    with pytest.raises(ManifestError):
        open_store(dataset, "none")
