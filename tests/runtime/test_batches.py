"""One bad item never sinks a batch: the rule, and every command that keeps it."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from swarmdata.catalogue.build_catalogue import CatalogueChoices, build_catalogue
from swarmdata.cli.main import app
from swarmdata.errors import BatchError, DiskFullError, SchemaError, SpecError
from swarmdata.registry.published import TaskReferences
from swarmdata.runtime.batches import Failures
from swarmdata.runtime.engines.jobs import Job
from swarmdata.runtime.engines.open_engine import do_jobs
from tests.catalogue.conftest import little_published
from tests.support.own_task import make_thrifty, thrifty_installed
from tests.support.pairs import slow
from tests.support.tiny import TINY

RUNNER = CliRunner()


def test_the_others_go_on_and_all_that_failed_are_named() -> None:
    told: list[str] = []
    failures, done = Failures(3, told.append), []
    for name, error in (("a", ValueError("odd")), ("b", None), ("c", SpecError("wrong."))):
        with failures.item(name):
            if error is not None:
                raise error
            done.append(name)
    assert done == ["b"]
    assert told == ["failed: a: ValueError: odd", "failed: c: wrong."]
    with pytest.raises(BatchError, match=r"2 of 3 worlds failed: a: ValueError: odd; c: wrong\. "):
        failures.check("worlds")


def test_the_only_item_a_full_disk_and_an_interrupt_are_raised_as_they_are() -> None:
    for n, error in ((1, SpecError("wrong")), (2, DiskFullError("full")), (2, KeyboardInterrupt())):
        with pytest.raises(type(error)), Failures(n).item("a"):
            raise error
    Failures(2).check("worlds")


def handler() -> Any:
    def handle(payload: dict[str, Any], report: object) -> None:
        if payload["fails"]:
            raise SchemaError("no such thing")
        Path(payload["file"]).write_text("done")

    return handle


@pytest.mark.parametrize("workers", [1, *slow(2)])
def test_jobs_of_every_engine_go_on(tmp_path: Path, workers: int) -> None:
    jobs = [
        Job(name, {"file": str(tmp_path / name), "fails": name == "a"}) for name in ("a", "b", "c")
    ]
    with pytest.raises(BatchError, match=r"1 of 3 things failed: a: .*no such thing"):
        do_jobs(jobs, f"{__name__}:handler", "things", workers=workers, folder=tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b", "c"]


def test_references_of_the_other_tasks_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def measure(task: str, *_: object, **__: object) -> TaskReferences:
        if task == "transport":
            raise SchemaError("too heavy")
        return TaskReferences("0" * 64, n_episodes=3, made_with={}, policies={})

    place = "swarmdata.evaluation.results.target_evaluation.measure_references"
    monkeypatch.setattr(place, measure)
    out = tmp_path / "references.json"
    words = ["references", "formation", "transport", "search", "--out", str(out)]
    result = RUNNER.invoke(app, words)
    assert result.exit_code == 1
    assert "1 of 3 tasks failed: transport: too heavy" in result.stderr
    assert sorted(json.loads(out.read_text())) == ["formation", "search"]


@pytest.mark.parametrize("command", ["check", "update"])
def test_the_registry_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    from swarmdata.hub.publishing import regenerate
    from swarmdata.registry.published import published

    ids = sorted(published())[:3]

    def make(recipe: Any, **_: object) -> Any:
        if recipe.id == ids[0]:
            raise SchemaError("a robot is lost")
        return published()[recipe.id]

    monkeypatch.setattr(regenerate, "make_again", make)
    words = ["registry", command, *(word for each in ids for word in ("--id", each))]
    out = tmp_path / "published.json"
    result = RUNNER.invoke(app, [*words, *(["--out", str(out)] if command == "update" else [])])
    assert result.exit_code == 1
    assert f"1 of 3 datasets failed: {ids[0]}: a robot is lost" in result.stderr
    assert all(f"{each}: " in result.stdout for each in ids[1:])
    if command == "update":
        assert sorted(json.loads(out.read_text())) == ids[1:]


@pytest.mark.slow
def test_a_catalogue_has_all_that_can_be_shown(
    tmp_path: Path, tiny: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A dataset that cannot be written, a place without results, and a dataset that can."""
    thrifty = make_thrifty(tmp_path / "thrifty-tiny-v0")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.json").write_text("{}")

    def write(dataset: Any, *rest: object) -> None:
        if dataset.id == "thrifty-tiny-v0":
            raise KeyError("thrifty")

    monkeypatch.setattr("swarmdata.catalogue.entries.list_datasets", list)
    with thrifty_installed(), little_published():
        monkeypatch.setattr("swarmdata.catalogue.build_catalogue.write_data", write)
        choices = CatalogueChoices(results=(tmp_path / "run",))
        with pytest.raises(BatchError) as caught:
            build_catalogue([str(tiny), str(thrifty)], tmp_path / "site", choices)
    assert "thrifty-tiny-v0: KeyError: 'thrifty'" in str(caught.value)
    assert "run is a training run: evaluate it with" in str(caught.value)
    assert "_Document" not in str(caught.value)
    index = (tmp_path / "site" / "index.html").read_text()
    assert f"datasets/{TINY.id}.html" in index
    assert "thrifty" not in index
    assert not list((tmp_path / "site").rglob("*thrifty*"))
