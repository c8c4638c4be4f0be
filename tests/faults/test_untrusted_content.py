"""Content made to do harm: code in pickles and pages, compressed bombs, numbers that are none."""

import dataclasses
import io
import json
import pickle
import resource
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.behavior_policies.learned import Learned, digest_of, read_checkpoint
from swarmdata.behavior_policies.tiers import checkpoints
from swarmdata.cards import markdown
from swarmdata.cards.render import card_of
from swarmdata.errors import (
    CheckpointError,
    DatasetError,
    ManifestError,
    SchemaError,
    SpecError,
    TruncatedFileError,
)
from swarmdata.spec import PolicySource, Recipe, TaskSpec
from swarmdata.store import open_store, read_part_table, write_part
from swarmdata.testing.synthetic import make_dataset, make_episode
from tests.faults.test_damaged_datasets import list_again


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


@pytest.mark.parametrize(
    "change",
    [
        {"zarr_format": 2, "filters": [{"id": "pickle"}], "dtype": "|O"},
        {"data_type": "variable_length_bytes"},
        {"codecs": [{"name": "numcodecs.pickle", "configuration": {}}]},
        {"codecs": [{"name": "bytes"}, {"name": "zstd"}]},
    ],
)
def test_zarr_metadata_that_asks_for_code_or_compression_is_refused(
    tmp_path: Path, payload: tuple[bytes, Path], change: dict[str, Any]
) -> None:
    """Rows 16, 19: nothing is ever decompressed, so there is no bomb; nor unpickled."""
    make_dataset(tmp_path / "d", [[3] * 10])
    name = "data.zarr/rewards/zarr.json"
    content = json.loads((tmp_path / "d" / name).read_bytes())
    (tmp_path / "d" / name).write_text(json.dumps({**content, **change}))
    list_again(tmp_path / "d", name)
    with pytest.raises(ManifestError, match=r"rewards/zarr.json has"):
        open_store(tmp_path / "d")
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


def test_code_in_names_stays_text_on_a_card(tmp_path: Path, record: Callable[..., Path]) -> None:
    """Row 35: labels and tiers come from whoever made a recipe."""
    from swarmdata.store import assemble, merge_order

    source = open_store(record(tmp_path / "d", TaskSpec(horizon=20), ("random",)))
    hostile = f"{SCRIPT}|![](http://evil)\n# title"
    assert isinstance(source.recipe, Recipe)
    recipe = source.recipe.model_copy(
        update={
            "tier": hostile,
            "policies": (PolicySource(label=hostile, name="random"),),
        }
    )
    order = merge_order(recipe, [source.table.lengths.tolist()]).order
    parts = {0: [tmp_path / "d-part-0"]}
    assemble(tmp_path / "hostile", recipe=recipe, parts=parts, order=order)
    card = card_of(tmp_path / "hostile")

    _, front, body = card.split("---\n", 2)
    assert "<script>" not in body
    assert "&lt;script&gt;" in body
    assert "\n# title" not in card
    tables = [line for line in body.splitlines() if "alert" in line]
    assert tables
    assert all(line.startswith("| ") and "\\|" in line for line in tables)
    assert SCRIPT in front, "YAML keeps it as a string"


def test_a_cell_of_a_table_is_text() -> None:
    """Row 35: one line per row, and as many cells as the head has."""
    shown = markdown.table(("a", "b"), [("x|y", "<b>\n1 & 2")])
    assert shown.splitlines()[2] == "| x\\|y | &lt;b&gt; 1 &amp; 2 |"
