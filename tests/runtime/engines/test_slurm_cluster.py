"""A real SLURM on loopback: a node is drained, another fails, and the scheduler is lost."""

import os
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("submitit", reason="needs submitit")

from swarmdata.building.build import build
from swarmdata.building.parts_folder import build_folder
from swarmdata.errors import BuildError
from swarmdata.runtime.engines import slurm_executor
from swarmdata.runtime.engines.open_engine import open_engine
from swarmdata.store import read_manifest
from tests.runtime.engines.conftest import ENTRY, job, once_there, starts
from tests.runtime.engines.test_engines import study_tables
from tests.support.slurm_loopback import Slurm, slurm_cluster, why_not
from tests.support.tiny import TINY

REASON = why_not()
pytestmark = [pytest.mark.slow, pytest.mark.skipif(REASON is not None, reason=REASON or "")]

SOME = TINY.model_copy(update={"n_steps": 800})
"""Several parts of each policy."""


@pytest.fixture(scope="module")
def slurm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Slurm]:
    with slurm_cluster(tmp_path_factory.mktemp("slurm")) as cluster:
        yield cluster


@pytest.fixture(autouse=True)
def quick(handler: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Jobs find this package as well; a lost job is noticed soon."""
    paths = [str(tmp_path), str(Path.cwd()), *filter(None, sys.path)]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    monkeypatch.setattr(slurm_executor, "RESULT_SECONDS", 3.0)


def test_a_node_is_drained_while_a_dataset_is_made(slurm: Slurm, tmp_path: Path) -> None:
    expected = build(SOME, tmp_path / "alone", progress=False)
    out = tmp_path / "d"
    drained = once_there(build_folder(out), "policy-*", lambda: slurm.update("one", "DRAIN"))
    try:
        build(SOME, out, engine="slurm:debug", progress=False)
        drained.join()
        assert slurm.states()[0].startswith("drain")
    finally:
        slurm.update("one", "RESUME")
    assert read_manifest(out).digest == read_manifest(expected).digest
    assert (tmp_path / "d.slurm").is_dir()


def test_a_node_that_fails_and_a_scheduler_that_starts_again_lose_nothing(
    slurm: Slurm, tmp_path: Path
) -> None:
    jobs = [job(tmp_path, f"job-{k}", "wait") for k in range(4)]

    def disturb() -> None:
        slurm.wait_for(lambda: "one" in slurm.nodes_of_jobs(), "a job on a node")
        slurm.update("one", "DOWN")  # SLURM ends its job, and queues it again
        slurm.stop("slurmctld")
        time.sleep(3)
        slurm.start_controller()

    thread = threading.Thread(target=disturb, daemon=True)
    with open_engine("slurm", ENTRY, n_workers=1, folder=tmp_path / "x") as opened:
        thread.start()
        reports: list[int] = []
        opened.run(jobs, reports.append)
    thread.join()
    slurm.wait_for(lambda: slurm.states() == ["idle", "idle"], "idle nodes")
    assert sum(reports) == 4 * 7
    assert min(starts(tmp_path, each.name) for each in jobs) == 1


def test_a_job_that_is_killed_is_submitted_again_and_named_in_the_end(
    slurm: Slurm, tmp_path: Path
) -> None:
    with open_engine("slurm", ENTRY, n_workers=1, folder=tmp_path / "x") as opened:
        opened.run([job(tmp_path, "victim", "die once")], lambda n: None)
        assert starts(tmp_path, "victim") == 2
        with pytest.raises(BuildError, match=r"doomed failed.*3 times"):
            opened.run([job(tmp_path, "doomed", "die")], lambda n: None)


def test_ctrl_c_empties_the_queue(slurm: Slurm, tmp_path: Path) -> None:
    engine = open_engine("slurm", ENTRY, n_workers=1, folder=tmp_path / "x")

    def stop_at_first(job: object, error: BuildError) -> None:
        raise KeyboardInterrupt

    jobs = [job(tmp_path, "picky", "refuse"), *[job(tmp_path, f"{k}", "wait") for k in range(4)]]
    with pytest.raises(KeyboardInterrupt), engine as opened:
        opened.run(jobs, lambda n: None, stop_at_first)
    slurm.wait_for(lambda: slurm_executor.queued_jobs() == set(), "an empty queue")
    slurm.wait_for(lambda: slurm.states() == ["idle", "idle"], "idle nodes")


def test_a_study_has_the_tables_of_this_machine(slurm: Slurm, tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="cells are trained")
    pytest.importorskip("matplotlib", reason="a study has figures")

    data = tmp_path / TINY.id
    there = study_tables("slurm:debug", data, tmp_path / "there")
    assert there == study_tables("local", data, tmp_path / "here")
