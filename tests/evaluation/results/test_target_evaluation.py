"""Which reference policies a task has."""

from pathlib import Path

import pytest

from swarmdata.evaluation.results.target_evaluation import measure_references
from swarmdata.registry.presets import preset

SHARED = {"idle", "random", "straight", "scripted", "scripted-alone", "scripted-naive"}
NAIVE = {"pursuit-greedy", "pursuit-lead-1", "pursuit-lead-3", "pursuit-lead-mixed"}


@pytest.mark.parametrize(
    ("task", "more"),
    [("coop_nav", set()), ("search", {"scripted-deaf"}), ("pursuit", NAIVE)],
)
def test_a_task_is_measured_with_the_teams_that_it_has(
    task: str, more: set[str], tmp_path: Path
) -> None:
    file = tmp_path / "task.yaml"
    file.write_text(preset(task).with_updates(horizon=5).to_yaml())
    found = measure_references(str(file), 2, progress=False)
    assert set(found.policies) == SHARED | more
    assert set(found.gaps) == {"scripted-alone", "scripted-naive"} | more
