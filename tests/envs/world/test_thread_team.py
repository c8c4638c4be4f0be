"""Teams of threads: every part runs, errors and interrupts arrive, threads end."""

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

import numpy as np
import pytest

from swarmdata.envs.world.task_env import ThreadTeam
from swarmdata.runtime.kernels import kernel
from swarmdata.types import Int


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
        while len(in_a_call) < 100 and max(in_a_call, default=0) <= 10:
            before = len(ticks)
            count_up(out, 10_000_000)
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
