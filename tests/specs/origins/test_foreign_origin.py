"""Datasets of which another package defines a part that is not installed."""

import json
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from swarmdata import load
from swarmdata.analysis.coverage import coverage
from swarmdata.cli.main import app
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.registry.components import make_policy
from swarmdata.specs.origins.foreign_origin import foreign_origin
from swarmdata.specs.task_spec import TaskSpec
from tests.support.own_task import make_thrifty, thrifty_installed
from tests.support.tiny import TINY, Shelf

RUNNER = CliRunner()

MISSING = r"task 'thrifty', which is defined by another package \(tests\): install it"

SHAPES = {"observations": (9, 2, 5), "actions": (8, 2, 2), "states": (9, 16)}


@pytest.fixture(scope="module")
def thrifty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_thrifty(tmp_path_factory.mktemp("thrifty") / "thrifty-tiny-v0")


def test_arrays_and_episodes_are_those_that_the_package_reads(thrifty: Path) -> None:
    read = load(thrifty, verify="full")
    with thrifty_installed():
        whole = Dataset.open(thrifty)
        assert whole.recipe.missing is None
        arrays, names = whole.transitions(), whole.spec.agent_names
    assert read.recipe.missing is not None
    assert read.recipe.hash() == read.stored.manifest.recipe_hash
    assert read.spec.agent_names == names
    assert [each.label for each in read.recipe.policies] == ["a"]
    for name, values in read.transitions().items():
        assert np.array_equal(values, arrays[name]), name
    batch = next(read.split("train").sampler(4))
    assert batch.observations.shape[:2] == (4, len(names))


def test_what_needs_the_task_names_the_package(thrifty: Path) -> None:
    dataset = load(thrifty)
    uses: list[Callable[[], object]] = [
        lambda: dataset.task,
        lambda: dataset.reobserve("lidar-16"),
        lambda: load(thrifty, rewards={"progress": 2.0}),
        lambda: coverage(dataset.stored),
    ]
    for use in uses:
        with pytest.raises(SpecError, match=MISSING):
            use()


def command(*words: str) -> str:
    """The output of a command that has to end with exit code 1 and one sentence."""
    result = RUNNER.invoke(app, words)
    assert result.exit_code == 1, (words, result.output)
    assert result.exception is None or isinstance(result.exception, SystemExit), words
    return result.stderr


def test_commands_say_the_same_or_need_no_task(thrifty: Path, tmp_path: Path) -> None:
    name = str(thrifty)
    assert RUNNER.invoke(app, ["verify", name]).exit_code == 0
    assert RUNNER.invoke(app, ["info", name]).exit_code == 0
    train = ["train", "bc", name, "--out", str(tmp_path / "run")]
    for words in (
        ["verify", name, "--replay", "1"],
        ["audit", name],
        ["evaluate", name],
        *([] if find_spec("torch") is None else [train]),
        ["render", name, "--out", str(tmp_path / "picture.png")],
        ["filter", name, "--id", "a-b-v0", "--out", str(tmp_path / "new"), "--min-return", "0"],
    ):
        said = command(*words)
        assert "task 'thrifty', which is defined by another package (tests)" in said, (words, said)
    assert not list(tmp_path.iterdir())


def test_a_remote_gives_it(thrifty: Path, tmp_path: Path) -> None:
    shelf = Shelf(tmp_path / "shelf", thrifty)
    dataset = load(f"{shelf.address}/thrifty-tiny-v0")
    assert dataset.digest == load(thrifty).digest


def test_an_unknown_name_that_is_typed_may_be_of_another_package() -> None:
    for use in (
        lambda: TaskSpec.parse({"rules": {"task": "thrifty"}}),
        lambda: TaskSpec.parse({"observation": {"kind": "radar"}}),
        lambda: TaskSpec.parse({"communication": {"kind": "light"}}),
        lambda: make_policy("slow", TaskSpec()),
    ):
        with pytest.raises((SpecError, UnknownNameError), match="If another package defines it"):
            use()


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("origin 'dream'", {"kind": "dream", "policies": None}),
        ("environment 'sea'", {"spec": {"kind": "sea"}}),
        ("observation model 'radar'", {"spec": {"observation": {"kind": "radar"}}}),
        ("communication model 'light'", {"spec": {"communication": {"kind": "light"}}}),
    ],
)
def test_every_part_that_is_not_known_is_named(what: str, change: dict[str, object]) -> None:
    data = {**json.loads(TINY.to_json()), **change}
    found = foreign_origin(data, json.dumps(data), SHAPES, ("one", "two"), {})
    assert found is not None
    assert found.missing == f"{what}, which is defined by another package: install it"
    assert found.spec.n_agents == 2
    assert found.spec.observation_size == 5
    assert len(found.policies) == 2


@pytest.mark.parametrize("data", [None, [], {}, {"id": "a-b-v0", "spec": 3}, {"kind": "dream"}])
def test_what_is_malformed_is_of_no_package(data: object) -> None:
    assert foreign_origin(data, "", SHAPES, (), {}) is None
