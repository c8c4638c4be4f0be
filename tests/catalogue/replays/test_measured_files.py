"""Measured episodes come out of the files as they were measured; replays only if they repeat."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.catalogue.replays.measured_files import (
    measured_columns,
    play_again,
    run_names,
    write_measured,
)
from swarmdata.catalogue.result_sources import own_sources
from swarmdata.runtime.batches import Failures
from tests.support.measured import foreign, result
from tests.support.packed import unpack


def read(folder: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The table of a result, and its columns in their units."""
    found = re.fullmatch(
        r"swarmdata\.episodes\(\"[^\"]+\",(.*)\);\n", (folder / "episodes.js").read_text()
    )
    assert found is not None
    table = json.loads(found[1])
    text = re.fullmatch(
        r"swarmdata\.measured\(\"[^\"]+\",\"(.*)\"\);\n", (folder / "measured.js").read_text()
    )
    assert text is not None
    blocks = unpack(text[1], [(table["n"], 1)] * len(table["measured"]), 0)
    names = [(name, unit) for name, unit in table["measured"]]
    return table, {
        name: unit * block[:, 0] for (name, unit), block in zip(names, blocks, strict=True)
    }


def test_every_episode_of_every_run_is_there(tmp_path: Path) -> None:
    results = [result(index=k, mean=20.0 * k, seed=k) for k in range(3)]
    write_measured(results, [], tmp_path / "key")

    table, columns = read(tmp_path / "key")

    assert table["replays"] == 0
    assert (
        table["episodes"]["policies"]
        == run_names(results)
        == [f"training seed {k}" for k in range(3)]
    )
    n = len(results[0].evaluation.seeds)
    for run, number, value, end, time in zip(
        *(columns[name] for name in ("policy", "number", "return", "end", "time")), strict=True
    ):
        metrics = results[int(run)].evaluation.metrics
        assert value == pytest.approx(metrics["return"][int(number)], abs=1e-3)
        assert (end == 0) == (metrics["success"][int(number)] == 1)
        assert (time < 0) == np.isnan(metrics["time_to_goal"][int(number)])
    assert len(columns["number"]) == 3 * n


def test_environments_of_others_have_fewer_columns(tmp_path: Path) -> None:
    results = [foreign(**{"return": [1.0, 2.0], "length": [3.0, 5.0]})]

    assert measured_columns(results) == ["index", "policy", "return"]
    write_measured(results, [], tmp_path / "key")
    _, columns = read(tmp_path / "key")
    np.testing.assert_allclose(columns["return"], [1.0, 2.0])


@pytest.mark.slow
def test_runs_at_hand_are_played_again_and_others_are_said(measured: Path, tmp_path: Path) -> None:
    (source,) = own_sources([measured], Failures(1))
    (outcome,) = source.outcomes
    notes: list[str] = []
    played = play_again(outcome.results, notes.append)
    assert notes == []
    assert [each.run for each in played] == [0, 0, 0, 1, 1, 1]
    for each in played:
        metrics = outcome.results[each.run].evaluation.metrics
        assert each.episode.team_return == pytest.approx(metrics["return"][each.number], abs=1e-5)
    write_measured(outcome.results, played, tmp_path / "key")
    table, columns = read(tmp_path / "key")
    assert table["lengths"] == [len(each.episode) for each in played]
    assert columns["number"][:6].tolist() == [each.number for each in played]

    one = outcome.results[0]
    metrics = {**one.evaluation.metrics, "return": one.evaluation.metrics["return"] + 1.0}
    wrong = replace(one, evaluation=replace(one.evaluation, metrics=metrics))
    assert play_again([wrong], notes.append) == []
    assert len(notes) == 3
    assert "measured were" in notes[0]
    assert play_again([result()], notes.append) == [], "its run is not known"
