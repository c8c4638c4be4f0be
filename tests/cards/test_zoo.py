"""The runs of the package are those that the results of the study `regimes` are of."""

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
from swarmdata.learn.training.run_files import ZOO, find_run, run_hash, zoo
from swarmdata.registry.published import published

STUDY = Path(str(files("swarmdata.cards"))) / "studies" / "regimes" / "cells.tar.xz"


@pytest.fixture(scope="module")
def results() -> dict[str, list[dict[str, Any]]]:
    """The committed results of each shipped run, in the order of the seeds."""
    found: dict[str, list[dict[str, Any]]] = defaultdict(list)
    shipped = zoo()
    with tarfile.open(STUDY, mode="r:xz") as archive:
        for member in archive:
            cell, _, result = member.name.removeprefix("cells/").partition("/results/")
            if result and cell in shipped and (file := archive.extractfile(member)):
                found[cell].append(json.load(file))
    return {k: sorted(v, key=lambda each: each["provenance"]["index"]) for k, v in found.items()}


@pytest.mark.parametrize("name", zoo())
def test_a_run_is_the_one_that_was_measured(name: str, results: dict[str, Any]) -> None:
    run = find_run(ZOO + name)
    assert run is not None
    measured = results[name]
    for seed, result in enumerate(measured):
        assert run_hash(run, seed) == result["provenance"]["content"]
    (dataset,) = {each.dataset for each in read_trained(run).provenances}
    assert dataset is not None
    assert {each["provenance"]["digest"] for each in measured} == {published()[dataset].digest}


@pytest.mark.slow
def test_its_policies_get_the_measured_returns(results: dict[str, Any]) -> None:
    name = zoo()[0]
    target = find_target(ZOO + name)
    assert target.label == name.partition("/")[0]
    policy = swarmdata.make_policy(ZOO + name, seed=1)
    found = swarmdata.evaluate(policy, target.spec, n_episodes=3)
    expected = results[name][1]["metrics"]["return"][:3]
    np.testing.assert_allclose(found.metrics["return"], expected, atol=1e-4)


def test_another_name_is_one_error() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown run of the zoo 'bcc/coop_nav'.*Train"):
        find_target(f"{ZOO}bcc/coop_nav")
