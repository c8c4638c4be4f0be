"""Which reference policies a task has."""

from pathlib import Path

import pytest

from swarmdata.evaluation.results.target_evaluation import measure_references, reference_teams
from swarmdata.registry.presets import preset

SHARED = {"idle", "random", "straight", "scripted", "scripted-alone", "scripted-naive"}
NAIVE = {"pursuit-greedy", "pursuit-lead-1", "pursuit-lead-3", "pursuit-lead-mixed"}


@pytest.mark.parametrize(
    ("task", "more"),
    [("coop_nav", set()), ("search", {"scripted-deaf"}), ("pursuit", NAIVE)],
)
def test_a_task_has_the_teams_of_its_rules(task: str, more: set[str]) -> None:
    assert set(reference_teams("own.yaml", preset(task))) == SHARED | more


def test_a_task_is_measured_with_the_teams_that_it_has(tmp_path: Path) -> None:
    file = tmp_path / "task.yaml"
    file.write_text(preset("coop_nav").with_updates(horizon=5).to_yaml())
    found = measure_references(str(file), 2, progress=False)
    assert set(found.policies) == SHARED
    assert set(found.gaps) == {"scripted-alone", "scripted-naive"}
