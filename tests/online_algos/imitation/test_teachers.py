"""Teachers are as careful as their settings say; impossible ones are refused."""

from typing import Any

import numpy as np
import pytest

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.online_algos.dagger import DAggerConfig
from swarmdata.online_algos.imitation.teachers import TeacherSettings, make_teacher
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.specs.state_layout import X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec


def test_a_teacher_can_do_without_its_memory() -> None:
    search = preset("search")
    start = TeacherSettings(teacher="scripted", teacher_remembers=False)
    forgetful, other = make_teacher(start, search), make_policy("scripted", search)
    env = make_env(search, 4)
    step = env.reset(np.arange(4, dtype=np.uint64))
    for policy in (forgetful, other):
        policy.reset(step, np.arange(4))
    for _ in range(30):
        actions = other.act(step)
        forgotten = forgetful.act(step)
        step = env.step(actions)
    assert not np.array_equal(actions, forgotten)


def test_a_teacher_with_a_margin_keeps_robots_farther_apart() -> None:
    spec = preset("robotarium")
    copies = np.arange(4)

    def least_gap(margin: float) -> float:
        env = make_env(spec, 4)
        teacher = make_teacher(TeacherSettings(teacher="scripted", teacher_margin=margin), spec)
        step = env.reset(copies.astype(np.uint64))
        teacher.reset(step, copies)
        least = np.inf
        for _ in range(400):
            step = env.step(teacher.act(step))
            at = robots_of(step.states, spec.n_agents)[..., [X, Y]]
            apart = np.linalg.norm(at[:, :, None] - at[:, None], axis=-1)
            least = min(least, float(apart[apart > 0].min()))
        return least - 2 * spec.robots[0].radius

    assert least_gap(0.02) > least_gap(0.0) + 0.02


@pytest.mark.parametrize(
    ("kind", "wrong", "message"),
    [
        (TeacherSettings, {"teacher_margin": 0.1}, "set without a teacher"),
        (DAggerConfig, {"teacher": ""}, "teacher is empty"),
    ],
)
def test_impossible_settings_are_refused(kind: Any, wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        kind(**wrong)


def test_policies_that_are_not_there_or_cannot_forget_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="unknown policy 'nobody'"):
        make_teacher(TeacherSettings(teacher="nobody"), TaskSpec())
    forgetful = TeacherSettings(teacher="straight", teacher_remembers=False)
    with pytest.raises(SpecError, match="'straight' of task coop_nav cannot decide without"):
        make_teacher(forgetful, TaskSpec())
