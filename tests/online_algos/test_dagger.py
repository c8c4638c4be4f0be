"""DAgger: the teacher begins, the policies go on, and come closer to it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.online_algos import dagger
from swarmdata.online_algos.dagger import DAgger, DAggerConfig
from swarmdata.online_algos.imitation.teacher_cloning import collect, regress
from swarmdata.registry.components import make_env, make_policy
from swarmdata.specs.task_spec import TaskSpec

SPEC = TaskSpec(horizon=20)
SMALL: dict[str, Any] = {
    "teacher": "straight", "n_steps": 1024, "n_copies": 4, "rollout_steps": 32, "hidden": 16,
    "minibatch": 32,
}  # fmt: skip


def made(folder: Path, **changes: Any) -> DAgger:
    config = DAggerConfig(**{**SMALL, **changes})
    return DAgger(make_env(SPEC, config.n_copies), (3,), config, folder)


def test_policies_come_closer_to_the_teacher(tmp_path: Path) -> None:
    run = made(tmp_path)
    step = make_env(SPEC, 16).reset(np.arange(16, dtype=np.uint64))
    wanted = make_policy("straight", SPEC).act(step)
    before = np.square(run.policy(0).act(step) - wanted).mean()
    errors = []
    while run.frames < run.config.n_steps:
        errors.append(float(run.update()["error"]))
    assert len(errors) == 8
    assert errors[-1] < 0.5 * errors[0]
    assert np.square(run.policy(0).act(step) - wanted).mean() < 0.5 * before


def test_the_teacher_acts_in_the_first_round_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    acts = []

    def watch(*arguments: Any, teacher_acts: bool) -> Any:
        acts.append(teacher_acts)
        return collect(*arguments, teacher_acts=teacher_acts)

    monkeypatch.setattr(dagger, "collect", watch)
    run = made(tmp_path)
    for _ in range(3):
        run.update()
    assert acts == [True, False, False]
    assert len(run.states) == 3 * 32 * 4 * SPEC.n_agents, "of all rounds"


def test_the_rate_falls_and_passes_end_where_a_round_has_taken_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken, rates = [], []

    def watch(*arguments: Any) -> Any:
        taken.append(arguments[4])
        rates.append(arguments[6])
        return regress(*arguments)

    monkeypatch.setattr(dagger, "regress", watch)
    run = made(tmp_path, n_passes=3, max_samples=2000)
    for _ in range(2):
        run.update()
    assert taken == [3 * 512, 2000]
    assert rates == pytest.approx([1e-3, 1e-3 * (1 - 0.95 / 8)])
