"""Kills a writer before its k-th change of the disk, for one k after another, and looks after each.

A child is forked for each k; an audit hook counts what it opens for writing, makes, renames and
removes, and kills it. The parent then checks that nothing half-made is visible, does the operation
again in another child, and compares every byte with that of an undisturbed one.
"""

import json
import os
import shutil
import signal
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from swarmdata.building import build as build_module
from swarmdata.building.build import build_under_lock
from swarmdata.building.parts_folder import build_folder
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError
from swarmdata.hub.catalog.repair import repair
from swarmdata.hub.catalog.request import request_of_recipe
from swarmdata.hub.catalog.sources import Remotes, obtain
from swarmdata.interop.export import export_dataset
from swarmdata.store import open_store
from tests.support.one_process import use_one_process
from tests.support.tiny import TINY, Shelf, contents, flip, make_tiny

CHANGES = frozenset({"os.rename", "os.mkdir", "os.remove", "os.rmdir", "os.truncate"})


@dataclass(frozen=True)
class Operation:
    """Something that changes the disk below a folder."""

    prepare: Callable[[Path], None]
    run: Callable[[Path], object]
    check: Callable[[Path], None]  # after a kill, before it is run again


def is_change(event: str, arguments: tuple[Any, ...]) -> bool:
    """Whether an audit event is about to change the disk."""
    if event != "open":
        return event in CHANGES
    return bool(arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))


def forked(work: Callable[[], object]) -> int:
    """Runs something in a child and returns how it ended; standard error is left alone."""
    child = os.fork()
    if child == 0:
        try:
            work()
        except BaseException as error:
            sys.stderr.write(f"{type(error).__name__}: {error}\n")
            os._exit(1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def killed_at(k: int, work: Callable[[], object]) -> bool:
    """Runs something and kills it before its k-th change; False: it ended before."""
    left = k

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal left
        if is_change(event, arguments):
            left -= 1
            if left < 0:
                os.kill(os.getpid(), signal.SIGKILL)

    def run() -> None:
        sys.addaudithook(hook)
        work()

    code = forked(run)
    assert code in (0, -signal.SIGKILL), f"change {k}: the operation failed"
    return code != 0


def whole_or_absent(root: Path) -> None:
    """What can be seen of a new dataset can be used."""
    if (root / TINY.id).exists():
        open_store(root / TINY.id, "full")


def survived(operation: Operation, root: Path, stride: int) -> tuple[int, int]:
    """Returns the number of changes, and how many of the kills were survived: all, or it raises."""
    reference = root / "reference"
    operation.prepare(reference)
    operation.run(reference)  # here, so that no child has to import what it needs
    expected = contents(reference)
    for k, n_kills in zip(range(0, 10**6, stride), range(10**6), strict=False):
        place = root / f"kill-{k}"
        operation.prepare(place)
        if not killed_at(k, lambda place=place: operation.run(place)):  # type: ignore[misc]
            return k, n_kills
        operation.check(place)
        assert forked(lambda place=place: operation.run(place)) == 0, k  # type: ignore[misc]
        found = contents(place)
        assert found == expected, (k, sorted(found.keys() ^ expected.keys()))
        shutil.rmtree(place)
    raise AssertionError("the operation never ends")


def publishing(root: Path) -> Operation:
    """Putting a dataset together from its parts."""
    parts = make_parts(root / "parts")

    def with_parts(place: Path) -> None:
        place.mkdir()
        shutil.copytree(parts, build_folder(place / TINY.id))

    return Operation(
        with_parts,
        lambda place: build_under_lock(TINY, place / TINY.id, progress=False),
        whole_or_absent,
    )


def operations(root: Path) -> dict[str, Operation]:
    """Converting a dataset, repairing one, and fetching one."""
    dataset = make_tiny(root / "source" / TINY.id)
    shelf = Shelf(root / "shelf", dataset)

    def damaged(place: Path) -> None:
        shutil.copytree(dataset, place / TINY.id)
        flip(place / TINY.id / "data.zarr/states/c.0.0", 30)
        flip(place / TINY.id / "data.zarr/actions/c.0.0.0", 30)
        (place / TINY.id / "card.md").unlink()

    def others_are_whole(place: Path) -> None:
        for name, found in contents(place / TINY.id).items():
            if name.endswith(("states/c.0.0", "actions/c.0.0.0", "card.md")):
                continue
            if ".tmp-" not in name:
                assert found == (dataset / name).read_bytes(), name

    def export(place: Path) -> None:
        is_there = (place / "x.hdf5").exists()
        try:
            export_dataset(Dataset.open(dataset), place / "x.hdf5", format="d4rl")
        except ConversionError:
            assert is_there  # it was killed after the rename, and nothing is ever replaced

    def exported_or_absent(place: Path) -> None:
        expected = (root / "reference" / "x.hdf5").read_bytes()
        assert not (place / "x.hdf5").exists() or (place / "x.hdf5").read_bytes() == expected

    remotes = [shelf.address]
    return {
        "export": Operation(Path.mkdir, export, exported_or_absent),
        "repair": Operation(
            damaged,
            lambda place: repair(place / TINY.id, remotes=remotes, progress=False),
            others_are_whole,
        ),
        "fetch": Operation(
            Path.mkdir,
            lambda place: obtain(
                request_of_recipe(TINY, place / TINY.id), Remotes(remotes, progress=False)
            ),
            whole_or_absent,
        ),
    }


def make_parts(folder: Path) -> Path:
    """The finished parts of the tiny dataset."""
    folder.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build_module, "assemble", Mock(side_effect=InterruptedError))
        with pytest.raises(InterruptedError):
            make_tiny(folder / TINY.id)
    return build_folder(folder / TINY.id)


def survive(name: str, folder: str, stride: str) -> None:
    """Prints one JSON object: how many changes an operation makes, how many kills it survived."""
    warnings.simplefilter("error")
    use_one_process(pytest.MonkeyPatch())
    root = Path(folder)
    operation = publishing(root) if name == "publish" else operations(root)[name]
    n_changes, n_kills = survived(operation, root, int(stride))
    print(json.dumps({"operation": name, "changes": n_changes, "kills": n_kills}))
