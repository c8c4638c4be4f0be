"""Policies act on one thread, whatever the environment asks for; freed memory is used again."""

import json
import os
import platform
from importlib.util import find_spec

import pytest

from swarmdata.runtime.engines.jobs import THREAD_VARIABLES
from tests.support.interpreter import python

COUNT = """
import resource
from swarmdata.runtime.native_libraries import keep_freed_memory

def count():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(4):
        [b"x" * (20 << 20) for _ in range(4)]
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

if {keeps}:
    assert keep_freed_memory()
count()
print(count())
"""


def new_pages(*, keeps: bool) -> int:
    """New pages of a process that takes and frees 80 MiB four times, after it did so before."""
    return int(python("-c", COUNT.format(keeps=keeps)).stdout)


@pytest.mark.slow
@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="it is about glibc's allocator")
def test_freed_memory_is_used_again_without_new_pages() -> None:
    assert new_pages(keeps=True) < new_pages(keeps=False) / 10


PROGRAM = """
import json
import numpy as np
import torch
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.rollouts.function_policy import FunctionPolicy
from swarmdata.runtime.native_libraries import ThreadLimit
from threadpoolctl import threadpool_info, threadpool_limits

def numbers():
    return {torch.get_num_threads(), *(info["num_threads"] for info in threadpool_info())}

seen = {}
def act_in(name):
    def act(observations):
        seen[name] = [*numbers()]
        return np.zeros((*observations.shape[:2], 2), np.float32)
    return FunctionPolicy(act)

spec = preset("coop_nav").model_copy(update={"horizon": 2})
evaluate(act_in("first"), spec, name="still", n_episodes=1, progress=False)  # loads all libraries
torch.set_num_threads(3)  # at its start it takes no more than there are cores
threadpool_limits(3)  # and neither do the libraries of products
seen["before"] = [*numbers()]
evaluate(act_in("evaluate"), spec, name="still", n_episodes=1, progress=False)
evaluate(act_in("asked"), spec, name="still", n_episodes=1, policy_threads=2, progress=False)
with ThreadLimit(2):
    evaluate(act_in("inside"), spec, name="still", n_episodes=1, progress=False)
    seen["between"] = [*numbers()]
seen["after"] = [*numbers()]
print(json.dumps(seen))
"""


@pytest.mark.slow
@pytest.mark.skipif(find_spec("torch") is None, reason="it is about the threads of torch")
def test_policies_act_on_one_thread_and_the_numbers_are_given_back() -> None:
    """In a process of its own, which the settings of the tests do not reach."""
    own = {name: text for name, text in os.environ.items() if name not in THREAD_VARIABLES}
    found = python("-c", PROGRAM, env=own).stdout
    assert json.loads(found) == {  # of torch and of every library of products
        "first": [1],
        "before": [3],
        "evaluate": [1],
        "asked": [2],
        "inside": [1],
        "between": [2],
        "after": [3],
    }
