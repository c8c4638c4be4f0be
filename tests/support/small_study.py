"""A study of two cells on a tiny dataset, also in another task and under noise, and its tables."""

from concurrent.futures import Executor
from pathlib import Path

from swarmdata.building.build import build
from swarmdata.evaluation.study.plan import Study
from swarmdata.evaluation.study.run_study import StudyOptions, run_study
from tests.support.tiny import TINY


def study_tables(engine: str | Executor, data: Path, folder: Path) -> dict[str, bytes]:
    """Runs the study by an engine; returns its tables, but for those of costs.

    Args:
        engine: as `run_study` takes it.
        data: folder of the dataset, which is made if it is absent.
        folder: of the study.
    """
    build(TINY, data, workers=1, progress=False)
    cell = {"algorithm": "bc", "family": "cloning", "updates": 4}
    plan = {
        "name": "tiny",
        "datasets": [str(data)],
        "algorithms": {"bc": cell, "other": {**cell, "settings": {"output": "clip"}}},
        "seeds": [0, 1],
        "hidden": [8],
        "episodes": 4,
        "tasks": {
            "datasets": [str(data)], "algorithms": ["bc"], "tasks": ["coop_nav-easy"],
            "episodes": 3,
        },
        "sweeps": {
            "noise": {"dataset": str(data), "vary": "observation", "axis": "noise=0,0.2",
                      "points": 2, "episodes": 2},
        },
    }  # fmt: skip
    options = StudyOptions(folder / "out", folder / "work", 2, engine, progress=False)
    failures, _ = run_study(Study.parse(plan, "the test's study"), options, "the command")
    assert failures == {}
    out = folder / "out"
    tables = {str(file.relative_to(out)): file for file in sorted(out.rglob("*.csv"))}
    assert {"results.csv", "tasks.csv", "sweeps/noise/sweep.csv"} <= tables.keys()
    return {name: file.read_bytes() for name, file in tables.items() if "cost" not in name}
