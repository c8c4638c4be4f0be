"""Names, texts and files of observation models."""

from pathlib import Path
from typing import Any

import pytest

from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.specs.observation_names import observation_model
from swarmdata.specs.sensing_models import (
    BearingModel,
    Drift,
    LidarModel,
    OccupancyModel,
    SensorNoise,
    StateModel,
)

DRIFT = Drift(position=0.02, heading=0.02, turning=0.02)
NOISE = SensorNoise(position=0.05, range=0.05, velocity=0.05, direction=0.05)


@pytest.mark.parametrize(
    ("name", "model"),
    [
        ("state", StateModel()),
        ("lidar", LidarModel()),
        ("lidar-32", LidarModel(n_rays=32)),
        ("bearing-5", BearingModel(n_neighbors=5)),
        ("occupancy-11", OccupancyModel(cells=11)),
        ("state-5", StateModel(n_neighbors=5)),
        ("lidar+noise-0.05+stack-4", LidarModel(noise=NOISE, stack=4)),
        ("bearing+delay-2+dropout-0.1", BearingModel(delay=2, dropout=0.1)),
        ("lidar+range-1.5", LidarModel(range=1.5)),
        ("state+range-1.5", StateModel(limit=1.5)),
        ("state-0+goal-for-10", StateModel(n_neighbors=0, goal_steps=10)),
        ("bearing+goal-for-0+stack-2", BearingModel(goal_steps=0, stack=2)),
        ("state+noise-5e-2", StateModel(noise=NOISE)),
        ("bearing+ways+delay-1", BearingModel(ways=True, delay=1)),
        ("lidar+no-velocities+stack-2", LidarModel(velocities=False, stack=2)),
        ("lidar+drift-0.02", LidarModel(drift=DRIFT)),
        ("drift-0.02+landmarks-0.5", StateModel(drift=DRIFT, landmarks=0.5)),
        ("state+body-frame", StateModel(frame="body")),
        ("kind: lidar\nn_rays: 8", LidarModel(n_rays=8)),
        ('{"kind": "occupancy", "cells": 5}', OccupancyModel(cells=5)),
        ({"kind": "bearing", "noise": {"range": 0.1}}, BearingModel(noise=SensorNoise(range=0.1))),
        (LidarModel(n_rays=3), LidarModel(n_rays=3)),
    ],
)
def test_names_texts_fields_and_models(name: Any, model: Any) -> None:
    assert observation_model(name) == model


OWN = StateModel(
    n_neighbors=2, limit=1.0, ways=True, noise=SensorNoise(position=0.3), dropout=0.5, delay=1
)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        (
            "state+noise-0.4",
            {"noise": SensorNoise(position=0.5, velocity=0.4, direction=0.4, range=0.4)},
        ),
        ("dropout-0.5+stack-2", {"dropout": 0.75, "stack": 2}),
        ("state-5+delay-2", {"n_neighbors": 5, "delay": 3}),
        ("range-0.5", {"limit": 0.5}),
        ("state", {}),
        ("noise-0", {}),
        ("dropout-0+delay-0+drift-0", {}),
    ],
)
def test_names_modify_the_model_of_a_task(name: str, changes: dict[str, Any]) -> None:
    assert observation_model(name, OWN) == OWN.model_copy(update=changes)
    assert observation_model(f"={name}", OWN) == observation_model(name)


def test_another_kind_of_sensor_keeps_what_all_kinds_have() -> None:
    shared: dict[str, Any] = {"ways": True, "noise": SensorNoise(position=0.3), "dropout": 0.5}
    assert observation_model("lidar-8+delay-2", OWN) == LidarModel(n_rays=8, delay=3, **shared)
    assert observation_model("=lidar-8+delay-2", OWN) == LidarModel(n_rays=8, delay=2)


@pytest.mark.parametrize("source", [{"kind": "state"}, LidarModel(n_rays=3)])
def test_whole_models_replace_that_of_a_task(source: Any) -> None:
    assert observation_model(source, OWN) == observation_model(source)


def test_what_a_name_adds_is_checked_before_it_is_added() -> None:
    with pytest.raises(SpecError, match=r"noise\.position"):
        observation_model("noise--0.1", OWN)


def test_files(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(LidarModel(n_rays=9, noise=NOISE).to_yaml())
    assert observation_model(file) == observation_model(str(file))
    assert observation_model(file) == LidarModel(n_rays=9, noise=NOISE)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("lidr", "unknown observation model 'lidr'. Did you mean 'lidar'"),
        ("lidar+nose-0.1", "unknown modifier of observations 'nose'. Did you mean 'noise'"),
        ({"kind": "lidr"}, "unknown observation model 'lidr'. Did you mean 'lidar'"),
        ("lidar-many", "'lidar-many' in 'lidar-many' needs a number after the hyphen, got 'many'"),
        ("lidar+dropout-1.5", "dropout: expected at most 1 (got 1.5)"),
        ("lidar+stack-0", "stack: expected at least 1 (got 0)"),
        ("lidar+stack-2+stack-3", "stack is given twice"),
        ("state+no-velocities-3", "no-velocities takes no number in 'state+no-velocities-3'"),
        ("lidar+body-frame", "lidar is in the body's frame already in 'lidar+body-frame'"),
        ("occupancy+range-2", "occupancy has no range in 'occupancy+range-2'"),
        ({"n_rays": 3}, "got {'n_rays': 3}, expected a mapping with a key 'kind' (state, lidar"),
        ({"kind": "lidar", "rays": 3}, "rays: unknown key. Did you mean 'n_rays'?"),
        ("missing.yaml", "cannot read the observation model 'missing.yaml'"),
    ],
)
def test_what_is_wrong_is_said(name: Any, message: str) -> None:
    expected = UnknownNameError if message.startswith("unknown") else SpecError
    with pytest.raises(expected) as error:
        observation_model(name)
    assert message in str(error.value)
