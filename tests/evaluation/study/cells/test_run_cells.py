"""All cells: the longest first, failures apart, stale ones refused."""

from pathlib import Path
from typing import Any

import pytest

from swarmdata.errors import StaleCellError, UnknownNameError
from swarmdata.evaluation.study.cells.cell_costs import Attempt, Cost, CostMeter
from swarmdata.evaluation.study.cells.cells import COST_FILE, Cell, cells_of
from swarmdata.evaluation.study.cells.run_cells import (
    longest_first,
    remove_stale,
    run_cells,
    select_cells,
)
from swarmdata.evaluation.study.cells.study_data import digest_of
from swarmdata.evaluation.study.plan import Study
from swarmdata.runtime.locking import locked
from tests.evaluation.study.conftest import BC, Make


def cells(study: Study) -> list[Cell]:
    return cells_of(study, digest_of)


@pytest.mark.usefixtures("here")
def test_failures_do_not_stop_the_others(make_study: Make, tmp_path: Path) -> None:
    found = cells(make_study())
    bad = found[0].model_copy(update={"digest": "f" * 64})
    failures = run_cells([bad, found[1]], tmp_path, progress=False)
    assert list(failures) == ["bc/coop_nav-tiny-v0"]
    assert failures["bc/coop_nav-tiny-v0"].startswith("SchemaError: ")
    assert found[1].is_done(found[1].folder(tmp_path))
    (attempt,) = Cost.from_file(found[1].folder(tmp_path) / COST_FILE).attempts
    assert attempt.updates == 20
    assert run_cells([found[1]], tmp_path, progress=False) == {}


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_stale_cells_are_refused_and_done_again_when_asked(
    make_study: Make, tmp_path: Path
) -> None:
    before, after = (cells(make_study(episodes=n)) for n in (4, 5))
    run_cells(before[:1], tmp_path, progress=False)
    with pytest.raises(StaleCellError, match=r"bc/coop_nav-tiny-v0 \(n_episodes is 4.*--again"):
        run_cells(after, tmp_path, progress=False)
    assert before[0].is_done(before[0].folder(tmp_path))
    run_cells(after[:1], tmp_path, again=True, progress=False)
    assert after[0].is_done(after[0].folder(tmp_path))


@pytest.mark.usefixtures("here")
def test_a_cell_that_another_process_did_again_stays(
    make_study: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (before,), (after,) = (cells(make_study(algorithms={"bc": BC}, episodes=n)) for n in (2, 3))
    run_cells([before], tmp_path, progress=False)
    lock = "swarmdata.evaluation.study.cells.run_cells.locked"

    def wait(folder: Path) -> Any:
        monkeypatch.setattr(lock, locked)
        run_cells([after], tmp_path, again=True, progress=False)  # by the one that is waited for
        return locked(folder)

    monkeypatch.setattr(lock, wait)
    remove_stale([after], tmp_path, again=True)
    assert after.is_done(after.folder(tmp_path))


def test_the_longest_cells_begin_first(make_study: Make, tmp_path: Path) -> None:
    algorithms = {
        name: {**BC, "updates": updates}
        for name, updates in (("slow", 10), ("quick", 100), ("new", 30))
    }
    found = cells(make_study(algorithms=algorithms))
    for name, seconds in (("slow", 100.0), ("quick", 10.0)):
        attempt = Attempt(updates=100, train_seconds=seconds)
        file = tmp_path / "cells" / name / "earlier" / COST_FILE
        file.parent.mkdir(parents=True)
        file.write_text(Cost(attempts=(attempt,)).to_json())
    order = [cell.label for cell in longest_first(found, tmp_path)]
    assert order == ["new", "slow", "quick"]  # 30 s as the slowest known, 10 s and 10 s


def test_cells_are_chosen_by_pattern(make_study: Make) -> None:
    found = cells(make_study())
    assert [cell.label for cell in select_cells(found, "oth*/*")] == ["other"]
    assert select_cells(found, None) == found
    with pytest.raises(UnknownNameError, match="unknown cell 'bx/coop_nav"):
        select_cells(found, "bx/coop_nav-tiny-v0")


def test_what_the_process_did_before_is_no_cost_of_the_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [1000.0]
    monkeypatch.setattr("time.process_time", lambda: now[0])
    meter = CostMeter(tmp_path / COST_FILE)
    now[0] = 1012.5
    meter.write()
    assert Cost.from_file(tmp_path / COST_FILE).cpu_seconds == 12.5


def test_stages_inside_others_count_only_as_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr("time.perf_counter", lambda: now[0])
    earlier = Attempt(updates=5, train_seconds=2.0, peak_mb=1e6)
    (tmp_path / COST_FILE).write_text(Cost(attempts=(earlier,)).to_json())
    meter = CostMeter(tmp_path / COST_FILE)
    with meter.stage("train"):
        now[0] = 3.0
        with meter.stage("curve"):
            now[0] = 7.0
        now[0] = 8.0
        meter.add_updates(15)
    now[0] = 30.0
    with meter.stage("evaluate"):
        now[0] = 35.0
    meter.write()
    cost = Cost.from_file(tmp_path / COST_FILE)
    attempt = cost.attempts[1]
    assert (attempt.train_seconds, attempt.curve_seconds, attempt.evaluate_seconds) == (4, 4, 5)
    assert cost.updates_per_second == pytest.approx(20 / 6)
    assert cost.wall_seconds == 15
    assert cost.peak_mb == 1e6
