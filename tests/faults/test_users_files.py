"""Whatever a user has beside or in a dataset is there afterwards, byte for byte."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from swarmdata.building.build import build
from swarmdata.building.parts_folder import build_folder
from swarmdata.cli.main import app
from swarmdata.errors import (
    AddressError,
    BuildError,
    DatasetError,
    DatasetNotFoundError,
    OutputError,
)
from swarmdata.hub.catalog.catalog import find_folder, load
from swarmdata.hub.catalog.repair import examine, repair
from swarmdata.hub.catalog.request import request_of_recipe
from swarmdata.hub.catalog.sources import Remotes, obtain, obtain_release
from swarmdata.hub.remotes.pull_dataset import pull
from swarmdata.record.recording_folder import unfinished_folder
from swarmdata.store.arrays.layout import POSSIBLE_FILES
from swarmdata.store.scratch import scratch_folder
from tests.support.command_line import run
from tests.support.pairs import slow
from tests.support.tiny import TINY, Shelf, contents, flip

STATES = "data.zarr/states/c.0.0"
RUNNER = CliRunner()


pytestmark = pytest.mark.usefixtures("one_process")


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory, tiny: Path) -> Shelf:
    return Shelf(tmp_path_factory.mktemp("remote") / "shelf", tiny)


@pytest.fixture
def dataset(tiny: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(tiny, tmp_path / TINY.id))


def test_a_repair_of_what_is_no_dataset_touches_nothing(tmp_path: Path) -> None:
    """Row 36: links, and files that begin with .tmp-, are the user's."""
    home = tmp_path / "home"
    (home / "deep" / "deeper").mkdir(parents=True)
    (home / "deep" / "deeper" / "link").symlink_to(tmp_path)
    (home / "link").symlink_to("/nowhere")
    (home / ".tmp-notes").write_text("mine")
    (home / f".tmp-notes-{'0' * 32}").write_text("mine")
    (home / "recipe.json").write_text(TINY.to_json())
    before = contents(tmp_path)
    with pytest.raises(DatasetNotFoundError, match="nothing that only a dataset"):
        repair(home)
    result = RUNNER.invoke(app, ["verify", str(home), "--repair"])
    assert result.exit_code == 1
    assert "there is no dataset at" in result.stderr
    assert "--repair" not in result.stderr
    assert contents(tmp_path) == before
    assert [path.name for path in tmp_path.iterdir()] == ["home"], "not even a lock"


def test_no_message_advises_to_repair_or_delete_a_folder_of_somebody(tmp_path: Path) -> None:
    """Row 36: a web application has a manifest.json too."""
    (tmp_path / "manifest.json").write_text(json.dumps({"name": "my application"}))
    with pytest.raises(DatasetError) as caught:
        load(tmp_path)
    assert "delete" not in str(caught.value)
    assert "--repair" not in str(caught.value)


@pytest.mark.parametrize("name", ["", " ", "\t\n"])
@pytest.mark.parametrize("use", [load, find_folder])
def test_an_empty_name_is_one_error(use: Callable[[str], object], name: str) -> None:
    """Row 36: it is not the current folder, nor is an empty path."""
    with pytest.raises(AddressError, match="name of a dataset is"):
        use(name)
    with pytest.raises(AddressError, match="name of a dataset is"):
        load("coop_nav-random-mini", path=name)
    result = RUNNER.invoke(app, ["verify", name, "--repair"])
    assert (result.exit_code, "name of a dataset is" in result.stderr) == (1, True)


@pytest.mark.parametrize(
    "place", ["../{name}/", *slow(".", "link", "./", "..", "sub/..", "../{name}")]
)
def test_any_name_of_a_folder_works(
    dataset: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    """Row 37: relative, with dots and trailing slashes, and through a link."""
    whole, sub = contents(dataset), dataset / "sub"
    sub.mkdir()
    monkeypatch.chdir(sub if place == ".." else dataset.parent if place == "link" else dataset)
    if place == "link":
        Path("link").symlink_to(dataset)
    name = place.format(name=TINY.id)
    flip(dataset / STATES, 40)
    run("verify", name, "--repair")
    assert contents(dataset) == whole
    assert load(name).digest == load(dataset).digest
    for command in (["verify", name], ["card", name], ["audit", name, "--sample", "0"]):
        assert RUNNER.invoke(app, command).exit_code in (0, 1), command
    odd = [*dataset.parent.glob(".*"), *dataset.glob(".*"), *sub.iterdir()]
    assert odd == [], "no lock or scratch folder of a nameless folder"


def test_a_push_of_the_current_folder(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 37: and a pull to one, which is whole already or is not replaced."""
    (tmp_path / "remote").mkdir()
    (tmp_path / "here").mkdir()
    address = f"file://{tmp_path}/remote"
    monkeypatch.chdir(dataset)
    pushed = RUNNER.invoke(app, ["push", ".", address])
    assert pushed.exit_code == 0, pushed.output
    monkeypatch.chdir(tmp_path / "here")
    pulled = RUNNER.invoke(app, ["pull", f"{address}/{TINY.id}", "--out", "."])
    assert "cannot be pulled to the current folder" in pulled.stderr
    pulled = RUNNER.invoke(app, ["pull", f"{address}/{TINY.id}", "--out", "../here/d/"])
    assert pulled.exit_code == 0, pulled.output
    assert contents(tmp_path / "here" / "d") == contents(dataset)
    monkeypatch.chdir("d")
    assert RUNNER.invoke(app, ["pull", f"{address}/{TINY.id}", "--out", "."]).exit_code == 0


def _own(path: Path) -> Path:
    """Something of the user's that looks as if it were ours."""
    (path / "policy-0-part-00000").mkdir(parents=True)
    (path / "policy-0-part-00000" / "thesis.txt").write_text("three years of work")
    (path / "recipe.json").write_text("{}")
    (path / "notes").write_text("mine")
    (path / "link").symlink_to("notes")
    return path


KINDS = ("repair", "arriving", "pull", "pull.manifest", "build", "parts", "recording", "hub")


def test_folders_beside_a_dataset_are_the_users(dataset: Path, shelf: Shelf) -> None:
    """Row 38: X.repair, X.arriving and so on may be anybody's."""
    folder = dataset.parent
    for kind in KINDS:
        _own(folder / f"{TINY.id}.{kind}")
        _own(folder / f"new.{kind}")
    before = {
        name: what for name, what in contents(folder).items() if not name.startswith(TINY.id + "/")
    }
    flip(dataset / STATES, 40)
    repair(dataset, remotes=[], progress=False)
    (dataset / "card.md").unlink()
    build(TINY, dataset, progress=False)
    remotes = Remotes([shelf.address], progress=False)
    obtain(request_of_recipe(TINY, folder / "new"), remotes)
    release = shelf.find(TINY.id)
    assert release is not None
    pull(shelf, release, folder / "newer", progress=False)
    obtain_release(shelf, release, folder / "newest", progress=False)
    after = contents(folder)
    assert {name: after.get(name) for name in before} == before


def test_a_folder_in_the_way_of_a_build_is_named(tmp_path: Path) -> None:
    """Row 38: it is neither used nor removed."""
    before = contents(_own(tmp_path / "d.build"))
    (tmp_path / "d.build" / "recipe.json").unlink()
    before.pop("recipe.json")
    with pytest.raises(BuildError, match=r"d.build is not a folder of parts: .* Move it away"):
        build(TINY, tmp_path / "d", progress=False)
    assert contents(tmp_path / "d.build") == before


def test_parts_go_and_what_somebody_put_beside_them_stays(tmp_path: Path) -> None:
    """Row 38: only names that we give are removed."""
    parts = build_folder(tmp_path / "d")
    parts.mkdir()
    (parts / "recipe.json").write_text(TINY.to_json())
    (parts / "notes").write_text("mine")
    build(TINY, tmp_path / "d", progress=False)
    assert contents(parts) == {"notes": b"mine"}


def test_a_users_own_links_in_a_dataset_are_left(dataset: Path, tmp_path: Path) -> None:
    """Row 39: a link is refused, and replaced, only where a file of the dataset belongs."""
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "more").write_text("mine")
    (dataset / "notes").symlink_to(tmp_path / "data")
    (dataset / "data.zarr" / "plots").symlink_to(tmp_path / "data")
    assert load(dataset).n_episodes
    assert examine(dataset) == ()
    shutil.move(dataset / "data.zarr" / "states", tmp_path / "states")
    (dataset / "data.zarr" / "states").symlink_to(tmp_path / "states")
    elsewhere = contents(tmp_path / "states")
    repair(dataset, progress=False)
    assert load(dataset).n_episodes
    assert contents(tmp_path / "states") == elsewhere
    assert (dataset / "notes").is_symlink()
    assert (dataset / "data.zarr" / "plots").is_symlink()


@pytest.mark.parametrize("name", [STATES, "card.md", "manifest.json"])
def test_a_folder_where_a_file_belongs_is_left(dataset: Path, name: str) -> None:
    """Row 39: it is somebody's, so the repair says that it is in the way."""
    (dataset / name).unlink()
    (dataset / name).mkdir()
    (dataset / name / "thesis.txt").write_text("three years of work")
    before = contents(dataset)
    with pytest.raises(DatasetError, match=r"is a folder, expected a file .* move it away"):
        repair(dataset, progress=False)
    assert contents(dataset) == before


def test_a_file_where_a_folder_belongs_is_left(dataset: Path) -> None:
    """Row 39: the same of a file."""
    shutil.rmtree(dataset / "data.zarr" / "states")
    (dataset / "data.zarr" / "states").write_text("three years of work")
    with pytest.raises(DatasetError, match=r"is a file, expected a folder .* move it away"):
        repair(dataset, progress=False)
    assert (dataset / "data.zarr" / "states").read_text() == "three years of work"


NAMES = st.sampled_from(
    [
        *("notes", ".tmp-notes", f".tmp-card.md-{'c' * 31}", "recipe.json", "manifest.json"),
        *("card.md", "data.zarr", "zarr.json", "states", "actions", "c.0.0", "episodes", "a"),
        *(".swarmdata-d", "d.repair", "d.build", "d.arriving"),
    ]
)  # fmt: skip
TREES = st.dictionaries(
    st.lists(NAMES, min_size=1, max_size=3).map("/".join),
    st.one_of(st.binary(max_size=8), st.just("link"), st.just("{}")),
    max_size=8,
)
PIECES = st.sets(st.sampled_from(sorted({*POSSIBLE_FILES, *map(str, range(3))})), max_size=40)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(
    tree=TREES,
    beside=TREES,
    pieces=PIECES | st.just(frozenset(POSSIBLE_FILES)),
    use=st.integers(0, 3),
)
def test_every_file_of_the_user_is_there_afterwards(
    tiny: Path, shelf: Shelf, tree: dict[str, bytes | str], beside: dict[str, bytes | str],
    pieces: frozenset[str], use: int,
) -> None:  # fmt: skip
    """Rows 36 to 39: any tree, with any pieces of a dataset in it, before any of our commands."""
    with TemporaryDirectory(dir=tiny.parent) as scratch:
        place = Path(scratch)
        folder = place / "d"
        folder.mkdir()
        for piece in pieces:
            if (tiny / piece).is_file():
                (folder / piece).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(tiny / piece, folder / piece)
        made = _write(folder, tree, set(POSSIBLE_FILES)) | _write(place, beside, {"d"})
        before = {path: _look(path) for path in made}
        try:
            if use == 0:
                repair(folder, progress=False)
            elif use == 1:
                load(folder)
            elif use == 2:
                remotes = Remotes([shelf.address], progress=False)
                obtain(request_of_recipe(TINY, folder), remotes)
            else:
                release = shelf.find(TINY.id)
                assert release is not None
                pull(shelf, release, folder, progress=False)
        except (DatasetError, BuildError):
            pass
        assert {path: _look(path) for path in made} == before
        odd = [
            p.name for p in place.iterdir() if p.name.startswith(".swarmdata-") and p not in made
        ]
        assert [name for name in odd if "repair" in name or "pull" in name] == []


def _look(path: Path) -> bytes | str | None:
    if path.is_symlink():
        return os.readlink(path)  # noqa: PTH115 (as text)
    return path.read_bytes() if path.is_file() else None


def _write(root: Path, tree: dict[str, bytes | str], ours: set[str]) -> set[Path]:
    """Writes a user's files, but not in place of what a dataset has; returns their paths."""
    made = set()
    for name, what in tree.items():
        path = root / name
        if name in ours or path.exists() or path.is_symlink():
            continue
        if any(parent.is_symlink() or parent.is_file() for parent in path.parents):
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        if what == "link":
            path.symlink_to("notes")
        else:
            path.write_bytes(what if isinstance(what, bytes) else what.encode())
        made.add(path)
    return made


def test_work_folders_have_names_of_ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Row 38: the same in every process, beside the folder, also of a folder without a name."""
    monkeypatch.chdir(tmp_path)
    names = {scratch_folder(place, "repair") for place in (tmp_path, Path(), Path("x/.."))}
    assert len(names) == 1
    assert next(iter(names)).parent == tmp_path.parent
    assert build_folder(Path()) == tmp_path.parent / f"{tmp_path.name}.build"
    assert unfinished_folder(Path()) == tmp_path.parent / f"{tmp_path.name}.recording"


def test_a_folder_called_replay_is_the_users(tmp_path: Path) -> None:
    """Row 38: a finished online run removes its replay, so it must be its own."""
    pytest.importorskip("torch")
    from swarmdata.evaluation.runs.train import train_online

    (tmp_path / "replay").mkdir()
    (tmp_path / "replay" / "video.mp4").write_bytes(b"mine")
    with pytest.raises(OutputError, match=r"has files in it, such as replay, and is no run"):
        train_online("qmix", "coop_nav", tmp_path, progress=False)
    assert contents(tmp_path) == {"replay/video.mp4": b"mine"}


def test_a_film_takes_no_name_of_the_users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Row 38: the unfinished film was film.part.mp4, whoever had one."""
    image = pytest.importorskip("PIL.Image")
    from swarmdata.envs.render import video

    (tmp_path / "film.part.mp4").write_bytes(b"mine")
    monkeypatch.setattr(shutil, "which", lambda name: name)
    monkeypatch.setattr(video, "_feed", lambda command, *_: Path(command[-1]).write_bytes(b"film"))
    video.write_mp4([image.new("RGB", (2, 2))], tmp_path / "film.mp4", 0.1)
    assert contents(tmp_path) == {"film.mp4": b"film", "film.part.mp4": b"mine"}
