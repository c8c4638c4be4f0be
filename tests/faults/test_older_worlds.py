"""Datasets of an older version of the world, and the ids that a newer version has replaced."""

from collections.abc import Callable, Iterator
from pathlib import Path
from types import MappingProxyType

import pytest
from typer.testing import CliRunner

from swarmdata.audit import audit
from swarmdata.audit.resimulation import replay
from swarmdata.building import build
from swarmdata.cards.card import card_of
from swarmdata.cli.main import app
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import (
    ReplacedDatasetError,
    SchemaError,
    SpecError,
    UnknownNameError,
)
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.result_set import reference_of
from swarmdata.evaluation.study.cells.study_data import digest_of
from swarmdata.hub.catalog import identity
from swarmdata.hub.catalog.catalog import find_folder, load
from swarmdata.hub.catalog.repair import examine, repair
from swarmdata.hub.publishing.regenerate import published_ids
from swarmdata.registry import components, published
from swarmdata.registry.published import references, references_of
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.specs.task_spec import TaskSpec
from tests.support.one_process import use_one_process
from tests.support.tiny import TINY, Shelf, make_tiny

REPLACED = "coop_nav-random-mini-v0"
SENTENCE = f"{REPLACED} was replaced by coop_nav-random-mini-v1"
RUNNER = CliRunner()

pytestmark = pytest.mark.usefixtures("one_process")


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of world version 0, as the package that simulated it wrote it."""
    folder = tmp_path_factory.mktemp("old") / TINY.id
    with pytest.MonkeyPatch.context() as patch:
        use_one_process(patch)
        for module in (build, components):
            patch.setattr(module, "check_world", lambda spec: None)
        make_tiny(folder, spec=TaskSpec(horizon=40, version=0))
    return folder


@pytest.fixture
def cached(cache_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A dataset with an id of version 0 in the cache, none of which is published any more."""
    monkeypatch.setattr(identity, "published", lambda: MappingProxyType({}))
    return make_tiny(cache_folder / "datasets" / REPLACED, id=REPLACED)


def run(*arguments: str | Path, code: int = 0) -> str:
    result = RUNNER.invoke(app, list(map(str, arguments)))
    assert result.exit_code == code, result.output
    return result.output


def test_data_of_an_older_world_are_never_lost(old: Path, tmp_path: Path) -> None:
    """Row 71: they load, show, verify and can be seen through other sensors."""
    dataset = load(old)
    assert (dataset.task.version, len(dataset)) == (0, dataset.n_episodes)
    assert dataset[0].observations.shape[0] == len(dataset[0]) + 1
    assert next(dataset.sampler(batch_size=8)).rewards.shape == (8, 4)
    assert dataset.reobserve("lidar", "perfect").task.observation.kind == "lidar"
    assert (examine(old), repair(old)) == ((), ())
    assert "all files match the manifest" in run("verify", old)
    assert "older version of the world" in card_of(old)
    few = run("filter", old, "--id", "coop_nav-few-v0", "--policy", "a", "--out", tmp_path / "few")
    assert few
    assert Dataset.open(tmp_path / "few").task.version == 0


@pytest.mark.parametrize(
    "use",
    [
        lambda dataset: dataset.make_env(),
        lambda dataset: dataset.make_env(api="pettingzoo"),
        lambda dataset: replay(dataset, 1),
        lambda dataset: evaluate(
            components.make_policy("idle", dataset.task), dataset.task, name="idle"
        ),
        lambda dataset: digest_of(str(dataset.path)),
        lambda dataset: build.build(dataset.recipe, dataset.path.with_name("again")),
    ],
    ids=["vector", "pettingzoo", "replay", "evaluate", "study", "build"],
)
def test_an_older_world_is_not_simulated(old: Path, use: Callable[[Dataset], object]) -> None:
    """Row 71: one sentence says which package does, and nothing is written."""
    with pytest.raises(
        SpecError, match=r"world version 0 was simulated by swarmdata 0\.1"
    ) as caught:
        use(Dataset.open(old))
    assert "\n" not in str(caught.value)
    assert {path.suffix for path in old.parent.iterdir()} == {""}
    assert not old.with_name("again").exists()


def test_commands_say_so_in_one_line(old: Path, tmp_path: Path) -> None:
    """Row 71: also on the command line; an audit replays nothing, and checks all the rest."""
    pytest.importorskip("torch", reason="algorithms need torch")
    sentence = "world version 0 was simulated by swarmdata 0.1 (commit 7a313a1"
    assert sentence in run("verify", old, "--replay", "1", code=1)
    assert sentence in run("generate", old / "recipe.json", "--out", tmp_path / "x", code=1)
    assert sentence in run("audit", old)
    (tmp_path / "old.yaml").write_text("version: 0\n")
    task, out = tmp_path / "old.yaml", ("--out", tmp_path / "y")
    assert sentence in run("train-online", "mappo", task, *out, "--workers", "2", code=1)
    gif = ("--out", tmp_path / "y.gif")
    assert sentence in run("render", "scripted", "--task", task, *gif, code=1)
    assert not (tmp_path / "y").exists()
    found = audit(old)
    assert found.problems == ()
    assert any(sentence in str(each) for each in found.findings)


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """References of the current version of the world that the old dataset is of."""
    fresh = references()["coop_nav"].model_copy(update={"spec_hash": TaskSpec(horizon=40).hash()})
    references_of.cache_clear()
    monkeypatch.setattr(published, "references", lambda: {"coop_nav": fresh})
    yield
    references_of.cache_clear()


@pytest.mark.usefixtures("measured")
def test_an_older_world_has_no_score(old: Path, tmp_path: Path) -> None:
    """Row 71: references are those of exactly this spec, the version included."""
    current = load(make_tiny(tmp_path / TINY.id))
    assert current.normalized_score([1.0]) > 0
    assert "The mean return of this dataset scores" in card_of(current.path)
    assert (tmp_path / TINY.id / "references.json").exists()
    dataset = load(old)
    assert (dataset.references, reference_of(dataset.task)) == (None, None)
    with pytest.raises(SchemaError, match="references"):
        dataset.normalized_score([1.0])
    assert "No reference policies were measured for this spec" in card_of(old)
    assert not (old / "references.json").exists()


def test_policies_train_on_an_older_world_and_are_not_evaluated(old: Path, tmp_path: Path) -> None:
    """Row 71: a run keeps the version of its data, so its policies never play in another world."""
    pytest.importorskip("torch")
    run("train", "bc", old, "--seeds", "1", "--updates", "3", "--out", tmp_path / "bc")
    said = run("evaluate", tmp_path / "bc", "--out", tmp_path / "results", code=1)
    assert "SpecError: world version 0 was simulated by" in said


def test_an_older_card_is_kept(old: Path) -> None:
    """Row 71: what the package of that time wrote is no damage, and a lost card is written anew."""
    card = old / "card.md"
    text = card.read_text()
    card.write_text(f"{text}As it was written then.\n")
    assert (examine(old), repair(old)) == ((), ())
    card.unlink()
    assert [each.file for each in repair(old)] == ["card.md"]
    assert card.read_text() == text


@pytest.mark.parametrize(
    "use",
    [
        load,
        find_folder,
        find_target,
        lambda name: load(name, path="somewhere"),
        lambda name: published_ids([name]),
    ],
    ids=["load", "find_folder", "find_target", "path", "published_ids"],
)
def test_a_replaced_id_is_refused(
    use: Callable[[str], object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 72: no remote is asked, and a folder that happens to have its name is left alone."""
    shelf = Shelf(tmp_path / "shelf", make_tiny(tmp_path / "d", id=REPLACED))
    monkeypatch.setenv("SWARMDATA_REMOTES", shelf.address)
    (tmp_path / REPLACED).mkdir()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ReplacedDatasetError, match=SENTENCE):
        use(REPLACED)


@pytest.mark.parametrize(
    "command",
    ["generate", "info", "card", "pull", "verify", "audit", "render", "evaluate", "train", "push"],
)
def test_every_command_refuses_a_replaced_id(command: str, tmp_path: Path) -> None:
    """Row 72: with the same sentence."""
    if command == "train":
        pytest.importorskip("torch", reason="algorithms need torch")
    rest = {
        "render": ["--out", "x.gif"],
        "train": [REPLACED, "--out", "x"],
        "evaluate": ["--out", "x"],
        "push": [tmp_path.as_uri()],
    }
    first = "bc" if command == "train" else REPLACED
    code = 2 if command == "audit" else 1
    assert SENTENCE in run(command, first, *rest.get(command, []), code=code)


def test_a_replaced_dataset_in_the_cache_loads_by_its_id(cached: Path) -> None:
    """Row 72: data of the user stay usable; only the id with its version means them."""
    assert load(REPLACED).path == cached
    assert find_folder(REPLACED) == cached
    assert "its digest is published no more" in run("verify", REPLACED)
    assert find_folder("coop_nav-random-mini").name == "coop_nav-random-mini-v1"


def test_a_name_without_version_never_means_a_replaced_dataset(
    cache_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 72: not even where the package has no recipe of the name."""
    from swarmdata.hub.catalog import request

    def absent(name: str) -> None:
        raise UnknownNameError("dataset", name, ())

    monkeypatch.setattr(request, "find_recipe", absent)
    make_tiny(cache_folder / "datasets" / REPLACED, id=REPLACED)
    with pytest.raises(UnknownNameError, match="unknown dataset 'coop_nav-random-mini'"):
        load("coop_nav-random-mini", offline=True)


def test_a_remote_that_is_named_serves_a_replaced_dataset(
    tmp_path: Path, cache_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Row 72: as what it is."""
    monkeypatch.setattr(identity, "published", lambda: MappingProxyType({}))
    shelf = Shelf(tmp_path / "shelf", make_tiny(tmp_path / "d", id=REPLACED))
    assert load(f"{shelf.address}/{REPLACED}").id == REPLACED
    said = run("pull", REPLACED, "--from", shelf.address)
    assert "its digest is published no more" in said
    assert load(REPLACED).path == cache_folder / "datasets" / REPLACED
