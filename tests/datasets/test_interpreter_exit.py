"""A program that uses datasets and worlds beside other libraries ends without a word."""

from pathlib import Path

import pytest

from tests.support.interpreter import python

PROGRAM = """
import keyword as early
import logging, sys
import pettingzoo, zarr
if "torch" in sys.argv:
    import torch
import numpy as np
import swarmdata

logging.getLogger("swarmdata").setLevel(logging.ERROR)  # kernels may have to be compiled
dataset = swarmdata.Dataset.open(sys.argv[1])
if "public" in sys.argv:
    from swarmdata.envs.world import world
    world.load_addresses = lambda: None  # as where Munk2D's functions cannot be called
batch = next(dataset.sampler(4, seed=0))
if "torch" in sys.argv:
    batch = batch.to_torch()
env = dataset.make_env(2)
env.reset(np.arange(2, dtype=np.uint64))
env.step(np.zeros((2, env.spec.n_agents, env.action_size), np.float32))
env.close()
parallel = dataset.make_env(api="pettingzoo")
parallel.reset(seed=0)
parallel.close()
left_open = dataset.make_env(3)
left_open.reset(np.arange(3, dtype=np.uint64))
early.left_open = left_open, early  # lives until the modules that were imported later are cleared
early.function = lambda: early
print(len(dataset))
"""


@pytest.mark.slow
@pytest.mark.parametrize(("beside", "backend"), [("torch", "fast"), ("nothing", "public")])
def test_nothing_is_printed_at_exit(tiny: Path, beside: str, backend: str) -> None:
    if beside == "torch":
        pytest.importorskip("torch", reason="an extra")
    result = python("-c", PROGRAM, tiny, beside, backend, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    assert int(result.stdout) > 0
