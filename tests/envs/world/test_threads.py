"""Copies stepped by several threads: the bits of one thread, its errors, and nothing shared."""

import _thread
import gc
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from swarmdata.envs.world.task_env import TaskEnv, ThreadTeam
from swarmdata.errors import SchemaError, SpawnError
from swarmdata.interfaces import VecEnv
from swarmdata.registry.components import TASKS, make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.rollouts.rollout import rollout
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import STATE_FIELDS, STEP_FIELDS, Int, Seeds, Step
from tests.envs.worlds import assert_same
from tests.support.pairs import once_each


def names() -> list[str]:
    return [each.name for each in threading.enumerate() if each.name.startswith("swarmdata-step")]


def wait_for(is_so: Callable[[], bool]) -> None:
    end = time.monotonic() + 300
    while not is_so() and time.monotonic() < end:
        time.sleep(0.001)
    assert is_so()


def failing(error: BaseException) -> Callable[[], None]:
    def fail() -> None:
        raise error

    return fail


@pytest.mark.parametrize("size", [1, 2, 5])
def test_every_part_runs_once_and_the_first_in_the_calling_thread(size: int) -> None:
    team = ThreadTeam(size)
    ran: list[tuple[int, int]] = []

    def note(k: int) -> None:
        ran.append((k, threading.get_ident()))

    for n_parts in range(1, size + 1):
        ran.clear()
        team.run([partial(note, k) for k in range(n_parts)])
        assert sorted(k for k, _ in ran) == list(range(n_parts))
        assert [k for k, thread in ran if thread == threading.get_ident()] == [0]
    team.close()


@pytest.mark.slow
def test_threads_start_with_the_first_work_and_end_with_close_or_with_the_team() -> None:
    before = len(names())
    team = ThreadTeam(3)
    team.run([int])
    assert len(names()) == before
    meet = threading.Barrier(3, timeout=300).wait
    team.run([meet, meet, meet])
    assert len(names()) == before + 2
    team.close()
    team.close()
    assert len(names()) == before
    team.run([meet, meet, meet])  # starts again
    assert len(names()) == before + 2
    del team
    gc.collect()
    wait_for(lambda: len(names()) == before)


def test_the_error_of_the_first_part_arrives_unchanged_when_all_have_finished() -> None:
    team, finished = ThreadTeam(3), []
    first, second = ValueError("first"), KeyError("second")

    def slow() -> None:
        time.sleep(0.05)
        finished.append(True)

    with pytest.raises(KeyError) as caught:
        team.run([slow, failing(second), int])
    assert caught.value is second
    assert finished == [True]
    with pytest.raises(ValueError, match="first") as again:
        team.run([int, failing(first), failing(second)])
    assert again.value is first
    with pytest.raises(SystemExit):
        team.run([slow, failing(SystemExit(1))])
    team.run([slow, int, int])  # it goes on
    assert len(finished) == 3
    team.close()


def test_a_part_does_not_outlive_its_work() -> None:
    team = ThreadTeam(2)
    held = np.zeros(3)
    count = sys.getrefcount(held)
    team.run([int, partial(np.sum, held)])
    wait_for(lambda: sys.getrefcount(held) == count)  # just after it has said that it finished
    team.close()


def test_an_interrupt_waits_for_the_parts() -> None:
    team, finished = ThreadTeam(2), []

    def interrupt() -> None:
        _thread.interrupt_main(signal.SIGINT)
        time.sleep(0.05)  # the interrupt would be earlier, if nobody waited
        finished.append(True)

    with pytest.raises(KeyboardInterrupt):
        team.run([int, interrupt])
    assert finished == [True]
    team.run([int, partial(finished.append, True)])
    assert len(finished) == 2
    team.close()


@kernel
def count_up(out: Int, n: int) -> None:
    for k in range(n):
        out[0] = out[0] + (k ^ out[1])


def test_kernels_leave_the_interpreter() -> None:
    """While a kernel runs in a thread, this thread runs Python; on a busy machine, in some call."""
    team, out = ThreadTeam(2), np.zeros(2, dtype=np.int64)
    count_up(out, 1)
    ticks: list[float] = []
    in_a_call: list[int] = []
    end = threading.Event()

    def work() -> None:
        while len(in_a_call) < 20 and max(in_a_call, default=0) <= 10:
            before = len(ticks)
            count_up(out, 100_000_000)  # longer than a busy machine lets a thread wait
            in_a_call.append(len(ticks) - before)
        end.set()

    def tick() -> None:
        while not end.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0)

    team.run([tick, work])
    assert max(in_a_call) > 10
    team.close()


FORKED = """
import os, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # that a process with threads forks
from swarmdata.envs.world.task_env import ThreadTeam
team, ran = ThreadTeam(2), []
team.run([int, int])
child = os.fork()
team.run([lambda: ran.append(0), lambda: ran.append(1)])
team.close()
if child:
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
print(sorted(ran))
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_process_has_threads_of_its_own_and_open_teams_do_not_keep_it_alive() -> None:
    code = FORKED.replace("team.close()", "")
    for each in (FORKED, code):
        run = subprocess.run(
            [sys.executable, "-c", each], capture_output=True, text=True, timeout=300, check=True
        )
        assert run.stdout.split("\n")[:2] == ["[0, 1]", "[0, 1]"]


MODELS: dict[str, dict[str, Any]] = {
    "plain": {},
    "noisy radio": {
        "observation": {"kind": "bearing", "dropout": 0.1, "delay": 1, "stack": 2},
        "communication": {
            "kind": "broadcast", "range": 2.0, "drop_probability": 0.3, "delay": 2,
            "messages_per_step": 2,
        },
    },
    "noisy lidar": {"observation": {"kind": "lidar", "n_rays": 8, "noise": {"range": 0.05}}},
    "occupancy": {"observation": {"kind": "occupancy"}},
}  # fmt: skip


def some_seeds(n: int, first: int = 0) -> Seeds:
    return np.arange(first, first + n, dtype=np.uint64)


def drive(env: VecEnv, n_steps: int) -> list[Step]:
    """Steps with random actions; copies that end are reset in the next step."""
    rng = np.random.default_rng(3)
    steps, used = [env.reset(some_seeds(env.n_copies))], env.n_copies
    for _ in range(n_steps):
        actions = rng.uniform(-1, 1, (env.n_copies, env.spec.n_agents, env.action_size))
        steps.append(env.step(actions))
        ended = np.flatnonzero(steps[-1].ended)[::-1]
        if len(ended) > 1:  # the last of them stays as it is
            ended = ended[1:]
            steps.append(env.reset(some_seeds(len(ended), used), ended))
            used += len(ended)
    return steps


@pytest.mark.parametrize(("task", "models"), once_each(tuple(TASKS), tuple(MODELS)))
def test_every_number_of_threads_gives_the_same_bits(task: str, models: str) -> None:
    spec = preset(task).with_updates(horizon=12, **MODELS[models])
    if len(spec.sides) == 1:
        spec = spec.with_updates(on_collision="fail")
    expected = drive(make_env(spec, 7), 30)
    for n_threads in (2, 7):
        env = make_env(spec, 7, n_threads=n_threads)
        assert_same(drive(env, 30), expected)
        env.close()


def test_episodes_and_results_are_the_same() -> None:
    spec = preset("coop_nav").with_updates(horizon=20)
    policy, ids = make_policy("scripted", spec), some_seeds(11)
    env = make_env(spec, 4, n_threads=3)
    for one, two in zip(
        rollout(make_env(spec, 4), policy, ids), rollout(env, policy, ids), strict=True
    ):
        for name in (*STATE_FIELDS, *STEP_FIELDS):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    env.close()
    results = [
        evaluate(policy, spec, name="scripted", n_episodes=9, n_threads=n, progress=False)
        for n in (1, 2)
    ]
    for name, values in results[0].metrics.items():
        np.testing.assert_array_equal(values, results[1].metrics[name])
    assert not any(each.name == "swarmdata-step" for each in threading.enumerate())


@pytest.mark.parametrize("n_threads", [1, 2])
def test_a_malformed_action_leaves_every_world_as_it_was(n_threads: int) -> None:
    spec = preset("coop_nav")
    env, other = (make_env(spec, 4, n_threads=n_threads) for _ in range(2))
    for each in (env, other):
        each.reset(some_seeds(4))
    actions = np.full((4, 4, 2), 0.5)
    actions[3, 1, 0] = np.nan
    with pytest.raises(SchemaError, match="NaN or infinite"):
        env.step(actions)
    actions[3, 1, 0] = 0.5
    assert_same([env.step(actions)], [other.step(actions)])
    env.close()
    other.close()


@pytest.mark.parametrize("n_threads", [1, 2])
def test_a_layout_that_is_not_found_leaves_every_world_as_it_was(
    n_threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = preset("coop_nav")
    env, other = (make_env(spec, 4, n_threads=n_threads) for _ in range(2))
    for each in (env, other):
        each.reset(some_seeds(4))
    assert isinstance(env, TaskEnv)
    last = env._blocks[-1].task

    def fail(*_: object) -> None:
        raise SpawnError("no layout for seed 9")

    with monkeypatch.context() as patch:
        patch.setattr(last, "spawn", fail, raising=False)
        with pytest.raises(SpawnError, match="no layout for seed 9"):
            env.reset(some_seeds(4, 6))
    actions = np.full((4, 4, 2), 0.5)
    assert_same([env.step(actions)], [other.step(actions)])
    env.close()
    other.close()


def test_numbers_of_threads_are_checked() -> None:
    env = make_env(TaskSpec(), 2, n_threads=6)
    assert isinstance(env, TaskEnv)
    assert env.n_threads == 2
    env.close()
    with pytest.raises(SchemaError, match="n_threads is 0, expected at least 1"):
        make_env(TaskSpec(), 4, n_threads=0)
