"""The runs of the package are those that results of committed studies are of."""

import json
import tarfile
from collections import defaultdict
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="policies need torch")

import swarmdata
from swarmdata.errors import UnknownNameError
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.runs.trained_policies import read_trained
from swarmdata.evaluation.study.plan import Study
from swarmdata.learn.training.compact import is_same
from swarmdata.learn.training.run_files import ZOO, find_run, run_hash, seeds_of, zoo
from swarmdata.registry.published import published
from swarmdata.specs.plain_names import without_version

STUDIES = Path(str(files("swarmdata.cards"))) / "studies"

MEASURED = ("regimes", "seeds")
"""Studies with the results of all runs."""

COMPLETE = ("bc", "filtered_bc", "vdn", "mac_flow", "matd3")
"""Algorithms with a run on every dataset of the core."""


@pytest.fixture(scope="module")
def results() -> dict[str, list[dict[str, Any]]]:
    """The committed results of each shipped run by its name, in the order of the seeds."""
    found: dict[str, dict[int, dict[str, Any]]] = defaultdict(dict)
    contents = {name: run_hash(Path(str(find_run(ZOO + name))), 0) for name in zoo()}
    for study in MEASURED:
        with tarfile.open(STUDIES / study / "cells.tar.xz", mode="r:xz") as archive:
            for member in archive:
                cell, _, result = member.name.removeprefix("cells/").partition("/results/")
                name = cell.replace("-again/", "/")  # rows of `seeds` with new seeds
                if result and name in contents and (file := archive.extractfile(member)):
                    row = json.load(file)
                    if row["provenance"]["content"] == contents[name]:
                        found[name][row["provenance"]["index"]] = row
    return {name: [rows[k] for k in sorted(rows)] for name, rows in found.items()}


@pytest.mark.parametrize("name", zoo())
def test_a_run_is_one_that_was_measured(name: str, results: dict[str, Any]) -> None:
    run = find_run(ZOO + name)
    assert run is not None
    measured = results[name]
    assert [each["provenance"]["seed"] for each in measured] == [
        each.seed for each in seeds_of([run])
    ]
    assert len(measured) == 5
    (dataset,) = {each.dataset for each in read_trained(run).provenances}
    assert dataset is not None
    assert {each["provenance"]["digest"] for each in measured} == {published()[dataset].digest}
    (algorithm,) = {each["provenance"]["algorithm"] for each in measured}
    assert name == f"{algorithm}/{without_version(dataset)}"


@pytest.mark.slow
def test_its_policies_get_the_measured_returns(results: dict[str, Any]) -> None:
    name = zoo()[0]
    target = find_target(ZOO + name)
    assert target.label == name.partition("/")[0]
    policy = swarmdata.make_policy(ZOO + name, seed=results[name][1]["provenance"]["seed"])
    found = swarmdata.evaluate(policy, target.spec, n_episodes=3)
    expected = results[name][1]["metrics"]["return"][:3]
    np.testing.assert_allclose(found.metrics["return"], expected, atol=1e-4)


def test_five_algorithms_are_complete_on_the_core() -> None:
    core = Study.from_file(STUDIES / "regimes" / "study.yaml").core
    complete = {f"{name}/{without_version(data)}" for name in COMPLETE for data in core}
    assert complete <= set(zoo())
    text = (Path(__file__).parents[2] / "docs/evaluation.md").read_text(encoding="utf-8")
    assert f"and\n{len(zoo()) - len(complete)} others" in text
    for name in COMPLETE:
        assert f"`{name}`" in text


def test_the_first_seed_is_the_default() -> None:
    name = f"{ZOO}bc/formation-expert"
    run = find_run(name)
    assert run is not None
    first = seeds_of([run])[0].seed
    assert first == 5
    known = swarmdata.make_policy(name, seed=first)
    default = swarmdata.make_policy(name)
    assert is_same([known], [default])


def test_another_name_is_one_error() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown run of the zoo 'bcc/coop_nav'.*Train"):
        find_target(f"{ZOO}bcc/coop_nav")
