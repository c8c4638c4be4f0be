"""Algorithms with fusable methods learn the same when they are compiled, within rounding."""

from typing import Any

import pytest

torch = pytest.importorskip("torch", reason="compiling needs torch")

from swarmdata.learn.networks.compilation import fused, has_fusable  # noqa: E402
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve  # noqa: E402
from tests.contract.test_algorithms import SIZES, SMALL, draw, statistics  # noqa: E402

FUSABLE = [
    name
    for name in OFFLINE_ALGORITHMS
    if has_fusable(resolve("algorithm", OFFLINE_ALGORITHMS, name))
]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of torch's own compiler
@pytest.mark.parametrize("name", FUSABLE)
def test_compiled_updates_equal_plain_ones(name: str) -> None:
    kind: Any = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    config = kind.Config(**SMALL.get(name, {}))
    plain, compiled = (kind(SIZES, [0, 1], config, statistics=statistics()) for _ in range(2))
    for index in range(8):
        expected = plain.update(draw([0, 1], index))
        with fused():
            found = compiled.update(draw([0, 1], index))
        torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-4)
