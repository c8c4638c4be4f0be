"""Every offline algorithm differs from itself without what it is named after."""

from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="algorithms need torch")

from docs.site.ablations import ABLATIONS
from swarmdata.learn.training.training_data import Selective
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from swarmdata.testing.comparing import act_on
from swarmdata.testing.sample_batches import sample_setup
from swarmdata.testing.sample_batches import sample_step as step
from tests.contract.test_algorithms import SMALL, batches_of

N_UPDATES = 8
ABLATED = {name: ablation for name, ablation in ABLATIONS.items() if ablation is not None}


def made(name: str, settings: dict[str, Any]) -> Any:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    config = kind.Config(**{**SMALL[name], "n_updates": N_UPDATES, **settings})
    return kind(sample_setup((0,)), config)


def test_every_algorithm_has_an_ablation_or_is_the_clone() -> None:
    assert ABLATIONS.keys() == OFFLINE_ALGORITHMS.keys()
    assert [name for name in ABLATIONS if name not in ABLATED] == ["bc"]


@pytest.mark.parametrize("name", ABLATED)
def test_without_its_ingredient_it_learns_something_else(name: str) -> None:
    without = ABLATED[name]
    full = made(name, {})
    other = made(without.algorithm or name, without.settings)
    if isinstance(full.config, Selective):  # what it is named after is done to the data
        assert full.config.least_return(np.arange(100.0)) > 0
        assert not isinstance(other.config, Selective)
        return
    for algorithm in (full, other):
        for index in range(N_UPDATES):
            algorithm.update(batches_of(algorithm.config)((0,), index))
    ours, theirs = (act_on(algorithm.policy(0), step()) for algorithm in (full, other))
    assert np.abs(ours - theirs).max() > 0.0, "bits are equal only if the setting is ignored"
