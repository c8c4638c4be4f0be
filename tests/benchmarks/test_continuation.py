"""Curves of training that goes on: their table, and one small measurement."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the torch extra")

from swarmdata.evaluation.results.learning_curves import Curve
from swarmdata.registry.published import Reference
from swarmdata.specs.task_spec import TaskSpec
from tests.benchmarks import bench_continuation
from tests.benchmarks.bench_continuation import (
    METRICS,
    STARTS,
    Bench,
    Budget,
    head_of,
    main,
    rows_of,
    scored,
)
from tests.support.one_process import use_one_process
from tests.support.tiny import TINY, make_tiny


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """A return of 2 is a score of 100 in every task."""
    entry = SimpleNamespace(reference=Reference(no_skill=0.0, expert=2.0))
    monkeypatch.setattr(bench_continuation, "references_of", lambda _: entry)


def curves(steps: list[float], first: float) -> dict[str, Curve]:
    """Two seeds, one above the other."""
    values = np.stack([np.arange(len(steps)) + first, np.arange(len(steps)) + first + 1])
    return {name: Curve(np.array(steps), values) for name in METRICS}


def test_a_row_has_scores_at_the_steps_that_it_was_measured_at(known: None) -> None:
    ways = {"goes on": curves([0, 64, 128], 0.0), "from scratch": curves([64, 128], -1.0)}
    assert head_of(ways)[1:4] == ("0", "64", "128")
    on, scratch = rows_of("vdn", ways, TaskSpec())
    assert on[:4] == ("`vdn` goes on", "25.0 (0 to 50)", "75.0 (50 to 100)", "125.0 (100 to 150)")
    assert scratch[:4] == ("`vdn` from scratch", "", "-25.0 (-50 to 0)", "25.0 (0 to 50)")
    assert on[4:] == ("250 % / 250 %", "2.50 / 2.50")
    assert len(on) == len(scratch) == len(head_of(ways))


def test_a_task_without_references_has_no_scores() -> None:
    with pytest.raises(ValueError, match="no references were measured"):
        scored(curves([0], 0.0)["return"], TaskSpec(horizon=3))


def test_all_ways_of_an_algorithm_have_the_same_networks_and_batches(tmp_path: Path) -> None:
    bench = Bench("any", TaskSpec(), tmp_path, Budget(batch_size=8, units=16))
    for algorithm, start in STARTS.items():
        settings = bench.settings(algorithm)
        assert settings.pop("batch_size") == "8"
        assert settings == dict.fromkeys(start.networks, "16,16")


@pytest.mark.slow
@pytest.mark.usefixtures("known")
def test_three_ways_are_trained_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    use_one_process(monkeypatch)
    data = make_tiny(tmp_path / TINY.id)
    small = "--updates 6 --steps 9000 --points 2 --batch 8 --units 8 --seeds 2 --episodes 2"
    arguments = ["--dataset", str(data), "--out", str(tmp_path / "out"), *small.split()]
    main([*arguments, "--algorithms", "maddpg"])
    first = capsys.readouterr().out
    assert [line.split(" |")[0] for line in first.splitlines()[2:5]] == [
        "| `maddpg` goes on, share 0.5", "| `maddpg` goes on, no data", "| `maddpg` from scratch",
    ]  # fmt: skip
    assert (tmp_path / "out" / "maddpg.png").exists()
    main([*arguments, "--algorithms", "maddpg"])
    assert capsys.readouterr().out == first
