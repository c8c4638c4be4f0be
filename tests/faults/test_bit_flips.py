"""A hundred random bits are flipped, one at a time, in files of every kind: each one is found."""

import random
import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import DatasetError
from swarmdata.hub.catalog.repair import examine
from swarmdata.store import read_manifest
from swarmdata.store.arrays.layout import array_file
from tests.support.tiny import TINY, flip, make_tiny

N_FLIPS = 100


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_tiny(tmp_path_factory.mktemp("flips") / TINY.id, n_steps=160)


def kinds(path: Path) -> dict[str, list[tuple[str, int, int]]]:
    """(file, first byte, last byte) of everything that is stored, by what it is."""
    found: dict[str, list[tuple[str, int, int]]] = {
        name: []
        for name in ("data", "shard index", "array metadata", "group metadata", "recipe",
                     "manifest", "card")
    }  # fmt: skip
    manifest = read_manifest(path)
    arrays = {array_file(n, len(e.shape)): e.shard for n, e in manifest.arrays.items()}
    for file in sorted(p for p in path.rglob("*") if p.is_file()):
        name, size = str(file.relative_to(path)), file.stat().st_size
        if name in arrays:
            found["data"].append((name, 0, arrays[name].data_bytes - 1))
            found["shard index"].append((name, arrays[name].data_bytes, size - 1))
        elif file.name == "zarr.json":
            is_group = str(file.parent.relative_to(path)) in ("data.zarr", "data.zarr/episodes")
            found["group metadata" if is_group else "array metadata"].append((name, 0, size - 1))
        else:
            kind = {"recipe.json": "recipe", "manifest.json": "manifest"}.get(name, "card")
            found[kind].append((name, 0, size - 1))
    return found


def flips(path: Path) -> Iterator[tuple[str, str, int, int]]:
    """Kind, file, byte and bit of each flip: every kind in turn, so that all are well covered."""
    rng, places = random.Random(20), kinds(path)
    for index in range(N_FLIPS):
        kind = list(places)[index % len(places)]
        file, first, last = rng.choice(places[kind])
        yield kind, file, rng.randint(first, last), rng.randrange(8)


@pytest.mark.slow
def test_a_hundred_random_bit_flips_are_all_found_and_named(
    dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Row 09: `verify` names the file, and `load` refuses all but a damaged card."""
    tried = Counter[str]()
    for kind, file, byte, bit in flips(dataset):
        original = (dataset / file).read_bytes()
        flip(dataset / file, byte, bit)
        tried[kind] += 1
        try:
            damage = examine(dataset)
            assert [each.file for each in damage] == [file], (kind, file, byte, bit, damage)
            if kind == "data":
                assert damage[0].rows is not None
            if kind == "card":
                Dataset.open(dataset)  # nothing reads the card but people
            else:
                with pytest.raises(DatasetError) as caught:
                    Dataset.open(dataset)
                assert str(dataset / file) in str(caught.value), (kind, file, byte, bit)
        finally:
            (dataset / file).write_bytes(original)
    assert set(tried) == set(kinds(dataset))
    assert examine(dataset) == ()
    counts = ", ".join(f"{count} {kind}" for kind, count in tried.items())
    with capsys.disabled():
        print(f"\n{tried.total()} single-bit flips ({counts}): all found and named by verify,")
        print(f"{tried.total() - tried['card']} are refused by load already; the rest are cards.")


def test_a_flip_in_the_format_version_is_a_changed_file(dataset: Path, tmp_path: Path) -> None:
    """Row 09: not a dataset of a newer version."""
    copy = Path(shutil.copytree(dataset, tmp_path / "d"))
    text = (copy / "manifest.json").read_bytes()
    flip(copy / "manifest.json", text.index(b'"format_version": ') + 18, 1)
    (damage,) = examine(copy)
    assert "was changed after it was written" in str(damage)
