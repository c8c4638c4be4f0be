"""Files for others: they say what the dataset has, and change nothing in it."""

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from swarmdata.building.edit import filter_dataset
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import MissingFileError, SchemaError
from swarmdata.hub.publishing.metadata.croissant import croissant
from swarmdata.hub.publishing.metadata.episode_parquet import EPISODE_COLUMNS
from swarmdata.hub.publishing.metadata.hub_files import hub_card, metadata_files
from swarmdata.interop.logs.import_logs import import_logs
from swarmdata.store import SPLITS, write_file
from swarmdata.testing.synthetic import make_dataset
from swarmdata.types import END_REASONS
from tests.interop.logs.logged_team import drive, log_map, write_csv

parquet = pytest.importorskip("pyarrow.parquet", reason="the extra 'parquet'")


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("metadata") / "ds"
    make_dataset(path, [[4, 3, 5, 2] * 5, [2, 6] * 8], n_steps=60)
    (path / "card.md").write_text("---\npretty_name: mine\nlicense: mit\n---\n\n# mine\n")
    return path


@pytest.fixture
def folder(original: Path, tmp_path: Path) -> Path:
    """A dataset with a card."""
    return shutil.copytree(original, tmp_path / "ds")


def write_all(folder: Path) -> dict[str, bytes]:
    files = metadata_files(folder)
    for path, content in files.items():
        (folder / path).parent.mkdir(exist_ok=True)
        write_file(folder / path, content)
    return files


def test_the_table_has_the_episodes(folder: Path) -> None:
    dataset = Dataset.open(folder)
    digest = dataset.stored.manifest.transport_digest
    write_all(folder)
    table = parquet.read_table(folder / "episodes.parquet").to_pydict()
    assert list(table) == list(EPISODE_COLUMNS)
    stored = dataset.episodes
    for column in ("lengths", "seeds", "starts"):
        np.testing.assert_array_equal(table[column[:-1]], getattr(stored, column))
    np.testing.assert_array_equal(table["team_return"], stored.team_return)
    assert table["split"] == [SPLITS[code] for code in stored.split]
    assert table["end_reason"] == [END_REASONS[code] for code in stored.end_reason]
    assert set(table["policy"]) == {"tag-0", "tag-1"}
    again = Dataset.open(folder, verify="full")
    assert again.stored.manifest.transport_digest == digest


def test_splits_have_their_files(folder: Path) -> None:
    files = metadata_files(folder)
    dataset = Dataset.open(folder)
    assert set(files) == {
        "episodes.parquet", "croissant.json", *(f"episodes/{name}.parquet" for name in SPLITS)
    }  # fmt: skip
    write_all(folder)
    for name in SPLITS:
        rows = parquet.read_table(folder / f"episodes/{name}.parquet").to_pydict()
        view = dataset.split(name)  # type: ignore[arg-type]
        assert rows["episode"] == view.selection.tolist()
        assert set(rows["split"]) == {name}


def test_croissant_lists_every_file_with_its_checksum(folder: Path) -> None:
    content = json.loads(write_all(folder)["croissant.json"])
    listed = {entry["contentUrl"]: entry for entry in content["distribution"]}
    there = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
    assert set(listed) == there - {"croissant.json", "card.md"}
    for path, entry in listed.items():
        data = (folder / path).read_bytes()
        assert entry["sha256"] == hashlib.sha256(data).hexdigest(), path
        assert entry["contentSize"] == f"{len(data)} B"
    assert content["version"] == "0.0.0"


def test_croissant_claims_what_the_origin_tells(folder: Path, tmp_path: Path) -> None:
    """Logs of robots are not synthetic, and an edit names the data that it was made from."""
    made = Dataset.open(folder)
    drives = write_csv(tmp_path / "anna.csv", drive(12.0))
    logs = import_logs(
        [drives], tmp_path / "logs", id="hall-logs-v0", log_map=log_map(robots=["anna"])
    )
    edit = filter_dataset(made, tmp_path / "edit", id="mine-some-v0", episodes=range(8))
    found = [json.loads(croissant(each, {})) for each in (made, logs, edit)]
    assert [each.get("rai:hasSyntheticData") for each in found] == [True, False, True]
    assert found[2]["rai:dataLimitations"] == found[0]["rai:dataLimitations"]
    assert "made from other datasets by: filter" in found[2]["rai:dataCollection"]
    assert all(each["rai:dataSocialImpact"] for each in found)
    assert [len(each["prov:wasDerivedFrom"]) for each in found] == [0, 0, 1]
    assert found[2]["prov:wasDerivedFrom"][0]["identifier"] == f"sha256:{made.digest}"
    for dataset, each in zip((made, logs, edit), found, strict=True):
        assert dataset.recipe.hash() in each["prov:wasGeneratedBy"]["name"]


def test_without_pyarrow_there_is_still_croissant(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmdata.hub.publishing.metadata.hub_files.find_spec", lambda name: None)
    files = metadata_files(folder)
    assert set(files) == {"croissant.json"}
    assert "recordSet" not in json.loads(files["croissant.json"])
    assert "configs" not in hub_card(folder)


def test_the_hub_card_keeps_the_card(folder: Path) -> None:
    text = hub_card(folder)
    _, head, body = text.split("---\n", 2)
    front = yaml.safe_load(head)
    assert body == "\n# mine\n"
    assert (front["pretty_name"], front["license"]) == ("mine", "mit"), "the card's own words"
    assert front["task_categories"] == ["reinforcement-learning", "robotics"]
    assert front["size_categories"] == ["n<1K"]
    (config,) = front["configs"]
    assert [each["split"] for each in config["data_files"]] == list(SPLITS)
    files = metadata_files(folder)
    assert all(each["path"] in files for each in config["data_files"])
    info = front["dataset_info"]
    dtypes = {each["name"]: each["dtype"] for each in info["features"]}
    assert list(dtypes) == list(EPISODE_COLUMNS)
    assert (dtypes["team_return"], dtypes["seed"], dtypes["success"]) == (
        "float64",
        "uint64",
        "bool",
    )
    counts = [int((Dataset.open(folder).episodes.split == code).sum()) for code in range(3)]
    assert [each["num_examples"] for each in info["splits"]] == counts


def test_cards_that_cannot_be_used(folder: Path) -> None:
    (folder / "card.md").write_text("# only text\n")
    assert hub_card(folder).endswith("---\n\n# only text\n")
    for wrong in ("---\nno end", "---\n- a list\n---\n", "---\na: [\n---\n"):
        (folder / "card.md").write_text(wrong)
        with pytest.raises(SchemaError, match="front matter of the card"):
            hub_card(folder)
    (folder / "card.md").unlink()
    with pytest.raises(MissingFileError, match="has no card yet"):
        hub_card(folder)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of pandas and rdflib, which mlcroissant uses
def test_mlcroissant_accepts_it_and_notices_a_changed_file(folder: Path) -> None:
    library = pytest.importorskip("mlcroissant", reason="the dependency group 'interop'")
    write_all(folder)
    found = library.Dataset(jsonld=str(folder / "croissant.json"))
    assert not found.metadata.ctx.issues.errors
    (warning,) = found.metadata.ctx.issues.warnings
    assert "datePublished" in warning, "the text has no dates of its own"
    rows = list(found.records("episodes"))
    lengths = [row["episodes/length"] for row in rows]
    assert lengths == Dataset.open(folder).episodes.lengths.tolist()
    changed = bytearray((folder / "episodes.parquet").read_bytes())
    changed[len(changed) // 2] ^= 1
    (folder / "episodes.parquet").write_bytes(bytes(changed))
    with pytest.raises(Exception, match=r"episodes\.parquet"):
        list(library.Dataset(jsonld=str(folder / "croissant.json")).records("episodes"))
