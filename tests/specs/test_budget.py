"""Budgets: estimates hold what worlds take, and each limit can be reached and not passed."""

import tracemalloc
from typing import Any

import numpy as np
import pytest

from swarmdata.errors import SpecError
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.budget import (
    MAX_TOTAL_BYTES,
    copies_excess,
    demand_of,
    describe_demand,
    in_bytes,
)
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import TaskSpec
from tests.support.pairs import slow


@pytest.mark.parametrize(
    "changes",
    [
        {"team": [{"count": 128}], "arena": {"width": 30, "height": 30}},
        *slow(
            {"observation": {"kind": "lidar", "n_rays": 512, "stack": 16}},
            {"observation": {"kind": "occupancy", "cells": 64, "stack": 4}},
        ),
        {"observation": {"kind": "lidar", "n_rays": 256, "delay": 200}},
        {"observation": {"kind": "state", "ways": True}, "arena": {"width": 20, "height": 20}},
        {"communication": {"kind": "broadcast", "payload": "learned", "message_size": 1024}},
        {
            "team": [{"count": 64}],
            "arena": {"width": 30, "height": 30},
            "communication": {"kind": "broadcast", "delay": 300},
        },
    ],
)
def test_a_copy_takes_no_more_memory_than_estimated(changes: dict[str, Any]) -> None:
    spec = TaskSpec.parse(changes)
    estimate = demand_of(spec).copy_bytes
    _drive(spec)  # kernels are loaded once
    tracemalloc.start()
    _drive(spec)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert estimate / 20 < taken < 1.2 * estimate, f"{in_bytes(taken)} of {in_bytes(estimate)}"


def _drive(spec: TaskSpec) -> None:
    env = make_env(spec)
    env.reset(np.array([1], np.uint64))
    actions = np.zeros((1, spec.n_agents, spec.action_size), np.float32)
    for _ in range(3):
        env.step(actions)


def test_copies_are_bounded_together() -> None:
    spec = TaskSpec.parse({"observation": {"kind": "lidar", "n_rays": 1024, "stack": 16}})
    most = int(MAX_TOTAL_BYTES / demand_of(spec).copy_bytes)
    assert copies_excess(spec, most) is None
    for n in (0, -1, most + 1, 10**9):
        with pytest.raises(SpecError, match=f"expected from 1 to {most:,} copies"):
            make_env(spec, n)


def test_a_part_of_a_dataset_fits_into_memory() -> None:
    recipe: dict[str, Any] = {
        "id": "coop_nav-a-v0",
        "tier": "a",
        "spec": {"horizon": 100_000, "observation": {"kind": "lidar", "n_rays": 256}},
        "policies": [{"label": "a", "name": "random"}],
    }
    assert Recipe.parse({**recipe, "part_episodes": 1})
    with pytest.raises(SpecError, match=r"part_episodes is 256: a part may take about [0-9]+ GiB"):
        Recipe.parse(recipe)


def test_every_preset_is_far_below_the_limits() -> None:
    for name in preset_names():
        demand = demand_of(preset(name))
        assert demand.copy_bytes < 4e6
        assert demand.episode_bytes < 1e7
        assert demand.step_seconds < 1e-3
        assert demand.draw_seconds < 1
        assert "for a recorded episode" in describe_demand(demand)
