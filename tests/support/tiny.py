"""A dataset that is built in the test's own process in a moment, and remotes that hold it."""

import json
import os
import shutil
import uuid
from pathlib import Path
from typing import Any

import pytest

from swarmdata.building.build import build
from swarmdata.errors import HubError
from swarmdata.hub.remotes.hosts.folders import FolderRemote
from swarmdata.hub.remotes.interface import Release
from swarmdata.runtime.atomic import MARKER_FILE, TEMPORARY_PREFIX
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.manifest import _ZEROS, _digest
from tests.support.one_process import use_one_process

TINY = Recipe(
    id="coop_nav-tiny-v0",
    tier="random",
    spec=TaskSpec(horizon=40),
    policies=(
        PolicySource(label="a", name="random"),
        PolicySource(label="b", name="straight", share=2.0),
    ),
    seed=5,
    n_steps=400,
    part_episodes=4,
)


def make_tiny(out: Path, **changes: Any) -> Path:
    """Builds the tiny dataset, or one with other fields, in this process."""
    with pytest.MonkeyPatch.context() as patch:
        use_one_process(patch)
        return build(TINY.model_copy(update=changes), out, workers=1, progress=False)


def signed(content: dict[str, Any]) -> bytes:
    """A manifest with a right checksum, whatever it says."""
    blank = json.dumps({**content, "checksum": "0" * 64}).encode()
    return blank.replace(_ZEROS, _ZEROS.replace(b"0" * 64, _digest(blank)))


def sign(path: Path, content: dict[str, Any]) -> None:
    """Writes such a manifest."""
    (path / "manifest.json").write_bytes(signed(content))


def flip(path: Path, byte: int, bit: int = 0) -> None:
    """Changes one bit of a file in place."""
    content = bytearray(path.read_bytes())
    content[byte] ^= 1 << bit
    path.write_bytes(content)


def contents(folder: Path) -> dict[str, bytes | str]:
    """Every file below a folder with its bytes, and every link with its target."""
    return {
        str(path.relative_to(folder)): (
            os.readlink(path) if path.is_symlink() else path.read_bytes()  # noqa: PTH115 (as text)
        )
        for path in sorted(folder.rglob("*"))
        if path.is_symlink() or path.is_file()
    }


def abandoned(path: Path) -> Path:
    """What a killed writer of `path` leaves: a temporary folder with a marker that nobody holds."""
    folder = path.parent / f"{TEMPORARY_PREFIX}{path.name}-{uuid.uuid4().hex}"
    folder.mkdir(parents=True)
    (folder / MARKER_FILE).write_text("process 1 on a machine")
    (folder / path.name).write_text("half of it")
    return folder


class Shelf(FolderRemote):
    """A folder of datasets that counts its requests and may be made to fail."""

    def __init__(self, root: Path, *datasets: Path, fails: bool = False) -> None:
        root.mkdir()
        super().__init__(root.as_uri())
        self.fails, self.requests = fails, 0
        for dataset in datasets:
            shutil.copytree(
                dataset, root / json.loads((dataset / "manifest.json").read_bytes())["id"]
            )

    def find(self, dataset_id: str) -> Release | None:
        self._asked()
        return super().find(dataset_id)

    def ids(self) -> tuple[str, ...]:
        self._asked()
        return super().ids()

    def read(self, release: Release, file: str, out: Path, size: int) -> None:
        self._asked()
        super().read(release, file, out, size)

    def _asked(self) -> None:
        self.requests += 1
        if self.fails:
            raise HubError(f"{self.address} answered 503 four times.")
