"""Content made to do harm: code in pickles and pages, compressed bombs, numbers that are none."""

import dataclasses
import io
import json
import os
import pickle
import resource
import shutil
import socket
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.behavior_policies.checkpoint_files import (
    MAX_CHECKPOINT_BYTES,
    digest_of,
    read_checkpoint,
)
from swarmdata.behavior_policies.learned import Learned
from swarmdata.cards.card import card_of
from swarmdata.drawing import markdown
from swarmdata.errors import (
    CheckpointError,
    DatasetError,
    ManifestError,
    SchemaError,
    SpecError,
    TruncatedFileError,
)
from swarmdata.record import Recorder
from swarmdata.registry.presets import preset
from swarmdata.registry.recipes import checkpoints
from swarmdata.rollouts.recipe_episodes import make_source_policy
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import open_store
from swarmdata.store.parts import read_part_table, write_part
from swarmdata.testing.synthetic import make_dataset, make_episode
from tests.faults.test_damaged_datasets import list_again
from tests.record.worlds import Counting, play, steady


class Canary:
    """Makes a file when it is unpickled."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.file,)


@pytest.fixture
def payload(tmp_path: Path) -> tuple[bytes, Path]:
    """A pickle, and the file that is made when somebody loads it."""
    file = tmp_path / "canary"
    content = pickle.dumps(Canary(file))
    pickle.loads(content)
    file.unlink()  # it works
    return content, file


def test_a_pickle_in_a_part_is_not_executed(tmp_path: Path, payload: tuple[bytes, Path]) -> None:
    """Row 19: object arrays are refused, and bare pickles."""
    write_part(tmp_path / "part", [make_episode(3, seed=1)])
    objects = io.BytesIO()
    np.save(objects, np.array([Canary(payload[1])], dtype=object), allow_pickle=True)
    for content in (payload[0], objects.getvalue()):
        (tmp_path / "part" / "episodes.npy").write_bytes(content)
        with pytest.raises(TruncatedFileError, match="is damaged"):
            read_part_table(tmp_path / "part")
    assert not payload[1].exists()


def test_a_bomb_in_place_of_an_array_is_refused_by_its_size(tmp_path: Path) -> None:
    """Row 16: sizes follow from shapes, and are compared before anything is read."""
    make_dataset(tmp_path / "d", [[3] * 10])
    bomb = zlib.compress(bytes(64 << 20))
    (tmp_path / "d" / "data.zarr/rewards/c.0.0").write_bytes(bomb)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DatasetError, match=f"has {len(bomb)} bytes, expected"):
        open_store(tmp_path / "d")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # kB


def test_a_pickle_for_a_checkpoint_is_not_executed(
    tmp_path: Path, payload: tuple[bytes, Path]
) -> None:
    """Row 19: weights are safetensors, whatever the file is called."""
    file = tmp_path / "actor.safetensors"
    file.write_bytes(payload[0])
    with pytest.raises(CheckpointError):
        Learned(TaskSpec(), checkpoint=file, sha256=digest_of(file))
    assert not payload[1].exists()


@pytest.mark.parametrize("place", [0.0, 0.3, 0.999])
def test_a_flipped_bit_in_a_checkpoint_is_refused(tmp_path: Path, place: float) -> None:
    """Row 20: safetensors alone would load it without a word."""
    import swarmdata.behavior_policies as package

    shipped = checkpoints("coop_nav", "medium")[0]
    folder = Path(next(iter(package.__path__))) / "checkpoints"
    file = tmp_path / "copy.safetensors"
    shutil.copyfile(folder / shipped.file, file)
    read_checkpoint(file, shipped.sha256)
    content = bytearray(file.read_bytes())
    content[int(place * len(content))] ^= 4
    file.write_bytes(content)
    with pytest.raises(CheckpointError, match="SHA-256"):
        read_checkpoint(file, shipped.sha256)


def shipped_checkpoint() -> tuple[bytes, str]:
    """The bytes and the digest of a shipped actor."""
    shipped = checkpoints("coop_nav", "medium")[0]
    return read_checkpoint(shipped.file, shipped.sha256), shipped.sha256


@pytest.mark.parametrize(
    "name",
    ["/dev/zero", "/etc/passwd", "../x", "a/b.safetensors", "~/x", "", ".", "..", "a\x00b", "a\nb"],
)
def test_a_recipe_names_no_path(name: str) -> None:
    """Row 54: refused when the recipe is read, and again where the file would be."""
    with pytest.raises(SpecError, match=r"checkpoint: .*is not the name of a file, expected"):
        PolicySource.parse({"label": "a", "name": "learned", "checkpoint": name})
    source = PolicySource(label="a", name="learned", sha256="0" * 64)
    with pytest.raises(CheckpointError, match="is not the name of a file, expected"):
        make_source_policy(source.model_copy(update={"checkpoint": name}), TaskSpec())


def test_a_checkpoint_lies_in_the_package_or_in_the_datasets_folder(tmp_path: Path) -> None:
    """Row 54: nowhere else, and the package comes first."""
    content, digest = shipped_checkpoint()
    (tmp_path / "checkpoints").mkdir()
    (tmp_path / "checkpoints" / "mine.safetensors").write_bytes(content)
    (tmp_path / "mine.safetensors").write_bytes(content)
    assert read_checkpoint("mine.safetensors", digest, tmp_path) == content
    source = PolicySource(label="a", name="learned", checkpoint="mine.safetensors", sha256=digest)
    make_source_policy(source, preset("coop_nav"), tmp_path)
    with pytest.raises(CheckpointError, match="cannot read checkpoint"):
        make_source_policy(source, preset("coop_nav"))
    shipped = checkpoints("coop_nav", "medium")[0]
    (tmp_path / "checkpoints" / shipped.file).write_bytes(b"other")
    assert read_checkpoint(shipped.file, digest, tmp_path) == content


def _link(path: Path, content: bytes) -> None:
    path.with_name("elsewhere").write_bytes(content)
    path.symlink_to(path.with_name("elsewhere"))


def _zeros(path: Path, _: bytes) -> None:
    path.symlink_to("/dev/zero")


def _hole(path: Path, _: bytes) -> None:
    with path.open("wb") as file:
        file.truncate(MAX_CHECKPOINT_BYTES + 1)


def _socket(path: Path, _: bytes) -> None:
    here = Path.cwd()
    os.chdir(path.parent)  # the name of a socket is short
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path.name)
    os.chdir(here)


MAKERS: dict[str, tuple[Callable[[Path, bytes], object], str]] = {
    "a link to the right file": (_link, "is a symbolic link"),
    "a link to a device": (_zeros, "is a symbolic link"),
    "a pipe": (lambda path, _: os.mkfifo(path), "is a pipe, expected a regular file"),
    "a folder": (lambda path, _: path.mkdir(), "is a folder, expected a regular file"),
    "a socket": (_socket, "is a socket, expected a regular file"),
    "a huge file": (_hole, f"has more than {MAX_CHECKPOINT_BYTES} bytes"),
}


@pytest.mark.parametrize("kind", MAKERS)
def test_a_checkpoint_is_a_regular_file_of_bounded_size(tmp_path: Path, kind: str) -> None:
    """Row 55: looked at before a byte of it is read; a pipe does not block."""
    content, digest = shipped_checkpoint()
    (tmp_path / "checkpoints").mkdir()
    make, message = MAKERS[kind]
    make(tmp_path / "checkpoints" / "x.safetensors", content)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(CheckpointError, match=message):
        read_checkpoint("x.safetensors", digest, tmp_path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # kB


def test_a_folder_of_checkpoints_is_no_link(tmp_path: Path) -> None:
    """Row 55: it could lead anywhere."""
    content, digest = shipped_checkpoint()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "x.safetensors").write_bytes(content)
    (tmp_path / "checkpoints").symlink_to("elsewhere")
    with pytest.raises(CheckpointError, match="is a symbolic link, expected a folder"):
        read_checkpoint("x.safetensors", digest, tmp_path)


def test_a_device_for_a_checkpoint_of_ones_own_is_refused() -> None:
    """Row 55: what users name themselves, too."""
    with pytest.raises(CheckpointError, match="is a device, expected a regular file"):
        read_checkpoint(Path("/dev/zero"), "0" * 64)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("field", ["observations", "states", "rewards", "log_probs", "sent"])
def test_generation_refuses_numbers_that_are_none(tmp_path: Path, field: str, value: float) -> None:
    """Row 34: before anything is on the disk."""
    episode = make_episode(4, seed=3)
    values = getattr(episode, field).copy()
    values.reshape(-1)[5] = value
    with pytest.raises(SchemaError, match=f"{field!r} has values that are not finite"):
        write_part(tmp_path / "part", [dataclasses.replace(episode, **{field: values})])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "name",
    ["../x-v0", "A B", "coop_nav", "coop_nav-medium", "coop_nav-médium-v0", "a-b-v0\n", "a-b-v0/",
     "/etc/passwd", "con", "a" * 95 + "-b-v0", "", "coop_nav-medium-v", "-a-v0", "a--b-v0"],
)  # fmt: skip
def test_a_recipe_has_a_plain_id(name: str) -> None:
    """Row 21: nothing that could leave a folder or mean something to a shell."""
    with pytest.raises(SpecError, match="id"):
        Recipe.parse(
            {"id": name, "tier": "x", "spec": {}, "policies": [{"label": "a", "name": "random"}]}
        )


SCRIPT = "<script>alert(1)</script>"


def test_code_in_free_text_stays_text_on_a_card(tmp_path: Path) -> None:
    """Row 35: what users say of a recording comes from whoever made it."""
    hostile = f"{SCRIPT}|![](http://evil)\n# title"
    with Recorder(
        Counting(), id="counting_v1-mine-v0", path=tmp_path / "ds", policies=("a",),
        metadata={"author": hostile, "description": hostile},
    ) as recorder:  # fmt: skip
        play(recorder, 20, steady)
    card = card_of(recorder.close().path)

    _, front, body = card.split("---\n", 2)
    assert "<script>" not in body
    assert "&lt;script&gt;" in body
    assert "\n# title" not in body
    assert SCRIPT not in front or '"' in front or "'" in front, "YAML keeps it as a string"


def test_code_in_labels_and_tiers_is_refused(record: Callable[..., Path], tmp_path: Path) -> None:
    """Rows 35, 48: in a folder whose manifest is right, too."""
    folder = record(tmp_path / "d", TaskSpec(horizon=20), ("random",))
    recipe = json.loads((folder / "recipe.json").read_bytes())
    for change in ({"tier": SCRIPT}, {"policies": [{**recipe["policies"][0], "label": SCRIPT}]}):
        (folder / "recipe.json").write_text(json.dumps({**recipe, **change}))
        list_again(folder, "recipe.json")
        with pytest.raises(ManifestError, match="is no label, expected at most 256 of the char"):
            open_store(folder)


def test_a_cell_of_a_table_is_text() -> None:
    """Row 35: one line per row, and as many cells as the head has."""
    shown = markdown.table(("a", "b"), [("x|y", "<b>\n1 & 2")])
    assert shown.splitlines()[2] == "| x\\|y | &lt;b&gt; 1 &amp; 2 |"
