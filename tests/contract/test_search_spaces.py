"""Every offline algorithm has a search space that fits its config."""

import dataclasses
from itertools import islice
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.evaluation.tuning.tune import _drawn
from swarmdata.learn.training.settings import (
    as_texts,
    check_effects,
    drawn_settings,
    override,
    setting_types,
    space_of,
)
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from swarmdata.testing.sample_batches import sample_setup
from tests.contract.test_algorithms import SMALL, batches_of

N_DRAWN, N_UPDATES = 2, 2
CONSERVATIVE = ("cfcql", "icql_qs", "maddpg_cql", "omar")


def kind_of(name: str) -> Any:
    return resolve("algorithm", OFFLINE_ALGORITHMS, name)


@pytest.mark.parametrize("name", OFFLINE_ALGORITHMS)
def test_the_default_lies_in_the_space_whose_keys_are_settings(name: str) -> None:
    space = space_of(kind_of(name), name)
    defaults = dataclasses.asdict(kind_of(name).Config())
    assert space.keys() <= setting_types(kind_of(name).Config).keys()
    assert [key for key in space if defaults[key] not in space[key]] == []


@pytest.mark.parametrize("name", OFFLINE_ALGORITHMS)
def test_what_is_drawn_trains(name: str) -> None:
    kind = kind_of(name)
    small = override(kind.Config(), as_texts({**SMALL[name], "n_updates": N_UPDATES}))
    for settings in islice(drawn_settings(space_of(kind, name), 0), N_DRAWN):
        config = override(small, as_texts(settings))
        assert dataclasses.asdict(config) | settings == dataclasses.asdict(config)
        algorithm = kind(sample_setup((0,)), config)
        for index in range(N_UPDATES):
            losses = algorithm.update(batches_of(config)((0,), index))
        assert all(np.isfinite(np.asarray(loss)).all() for loss in losses.values())


@pytest.mark.parametrize("name", OFFLINE_ALGORITHMS)
def test_what_tune_draws_is_what_train_takes(name: str) -> None:
    for settings in _drawn(name, {}, 20, 0):
        check_effects(override(kind_of(name).Config(), as_texts(settings)), settings)


@pytest.mark.parametrize("name", CONSERVATIVE)
def test_penalties_range_over_the_quality_of_data(name: str) -> None:
    penalty: Any = space_of(kind_of(name), name)["cql_weight"]
    assert penalty.high / penalty.low >= 1000
