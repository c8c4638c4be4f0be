"""The pushing controller says what it cannot serve."""

import pytest

from swarmdata.behavior_policies.transport.transport_controller import TransportController
from swarmdata.errors import SpecError
from swarmdata.registry.presets import preset
from swarmdata.specs.task_spec import TaskSpec

DEFAULT = preset("transport")
BOX = {"task": "transport", "payload": {"shape": "box"}}


def test_it_says_which_robots_and_goals_it_cannot_serve() -> None:
    with pytest.raises(SpecError, match="robot_0 has unicycle dynamics"):
        TransportController(
            DEFAULT.with_updates(team=[{"count": 4, "robot": {"dynamics": "unicycle"}}])
        )
    with pytest.raises(SpecError, match=r"goal_angle is 0\.2"):
        TransportController(DEFAULT.with_updates(rules={**BOX, "goal_angle": 0.2}))
    with pytest.raises(SpecError, match="expected 'transport'"):
        TransportController(TaskSpec())
