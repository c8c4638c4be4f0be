"""Algorithms with compilable methods learn the same when they are compiled, within rounding."""

from typing import Any

import pytest
import torch

from swarmdata.learn.networks.compilation import compiling, has_compilable
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from swarmdata.testing.sample_batches import sample_batch as draw
from swarmdata.testing.sample_batches import sample_setup
from tests.contract.test_algorithms import SMALL

pytestmark = pytest.mark.slow

COMPILABLE = [
    name
    for name in OFFLINE_ALGORITHMS
    if has_compilable(resolve("algorithm", OFFLINE_ALGORITHMS, name))
]


@pytest.mark.filterwarnings("ignore")  # of torch's own compiler
@pytest.mark.parametrize("name", COMPILABLE)
def test_compiled_updates_equal_plain_ones(name: str) -> None:
    kind: Any = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    config = kind.Config(**SMALL.get(name, {}))
    plain, fast = (kind(sample_setup([0, 1]), config) for _ in range(2))
    for index in range(8):
        expected = plain.update(draw([0, 1], index))
        with compiling():
            found = fast.update(draw([0, 1], index))
        torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-4)
