"""Every registered task keeps the contract."""

import pytest

from swarmdata.registry import TASKS, make_env
from swarmdata.spec import TaskSpec
from swarmdata.testing.task import check_task


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize(
    "change", [{}, {"horizon": 20}, {"team": [{"count": 1}]}, {"team": [{"count": 6}]}]
)
def test_task_keeps_the_contract(task: str, change: dict[str, object]) -> None:
    check_task(make_env, TaskSpec.parse({"rules": {"task": task}, **change}))
