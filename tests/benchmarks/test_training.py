"""Turns of training runs, and the tables that are made of them."""

import io
import json
import math
import time
from collections.abc import Iterator
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.benchmarks.bench_training import (
    OUR_EPOCHS,
    Trainee,
    rates,
    share_of_core,
    share_table,
    speed_table,
    take_turns,
    text,
)
from tests.benchmarks.trainers import Meter, Stopwatch, Turn

OURS = Turn(frames=2000, seconds=2.0, processor=1.0, rollout=0.5, worlds=0.2)
PEER = Turn(frames=100, seconds=1.0, processor=1.0, rollout=0.1, worlds=math.nan)
TIMES = st.floats(1e-3, 1e3)
TURNS = st.builds(Turn, st.integers(1, 10**6), TIMES, TIMES, TIMES, TIMES)


def test_the_meter_answers_once_for_each_order_with_whole_updates() -> None:
    answers = io.StringIO()
    meter = Meter(io.StringIO("0.02\n0\n"), answers)

    def train() -> None:
        while True:
            time.sleep(0.004)
            meter.add(10, 0.25, 0.125)

    with pytest.raises(SystemExit):
        train()
    first, second = (Turn(*json.loads(line)) for line in answers.getvalue().splitlines())
    assert first.seconds >= 0.02
    n_updates = first.frames // 10
    assert (first.rollout, first.worlds) == (0.25 * n_updates, 0.125 * n_updates)
    assert 1 <= n_updates <= 5
    assert second.frames == 10


def test_a_stopwatch_takes_the_place_of_a_method() -> None:
    owner = SimpleNamespace(work=lambda n: sum(range(n)))
    watch = Stopwatch(owner, "work")
    assert owner.work(100_000) == sum(range(100_000))
    assert watch.read() > 0
    assert watch.read() == 0


@given(answers=st.lists(TURNS, min_size=1, max_size=4))
def test_the_rates_of_processes_are_added(answers: list[Turn]) -> None:
    (wall,), (processor,) = rates([answers])
    assert wall == pytest.approx(sum(turn.frames / turn.seconds for turn in answers))
    assert processor == pytest.approx(sum(turn.frames / turn.processor for turn in answers))


@given(turn=TURNS, factor=st.floats(0.5, 2.0))
def test_what_slows_the_machine_in_a_round_changes_no_ratio(turn: Turn, factor: float) -> None:
    def slowed(by: float) -> dict[str, list[list[Turn]]]:
        ours, peer = (t._replace(processor=t.processor * by) for t in (turn, PEER))
        return {"ours": [[turn], [ours]], "peer": [[PEER], [peer]]}

    ratios = [
        speed_table(slowed(by), ["peer"]).splitlines()[2].split("|")[5] for by in (1.0, factor)
    ]
    assert ratios[0].split()[0] == ratios[1].split()[0]


def test_tables_show_rates_ratios_and_shares() -> None:
    turns = {"ours": [[OURS, OURS]], "peer": [[PEER]]}
    ours, peer = speed_table(turns, ["peer"]).splitlines()[2:]
    assert ours == "| ours | 2k (2k–2k) | 50 % | 4k (4k–4k) | 40 (40–40) |"
    assert peer.endswith("| 100 % | 100 (100–100) | 1 (1–1) |")
    assert speed_table(turns, []).splitlines()[2].count("|") == 5
    shares = share_table(turns).splitlines()[2:]
    assert shares == ["| ours | 20 % | 30 % | 50 % |", "| peer | — | 10 % | 90 % |"]


def test_a_busy_machine_and_an_absent_peer_are_said() -> None:
    idle, busy = [[OURS._replace(seconds=1.0)]], [[OURS]]
    assert share_of_core(busy) == 0.5
    alone = text({"one": idle, "two": busy}, [])
    assert "The machine was busy" in alone
    assert "BenchMARL is not installed here" in alone
    assert "621" in alone
    both = text({"ours": idle, "BenchMARL": [[PEER]]}, ["BenchMARL"])
    assert "busy" not in both
    assert "not installed" not in both
    assert "times BenchMARL" in both


def test_the_peer_passes_over_each_frame_as_often_as_we_do() -> None:
    mappo = pytest.importorskip("swarmdata.online_algos.mappo", exc_type=ImportError)
    assert mappo.MAPPOConfig().n_epochs == OUR_EPOCHS


@pytest.fixture
def trainee() -> Iterator[Trainee]:
    pytest.importorskip("torch")
    with Trainee(["ours", "1"], None) as it:
        yield it


@pytest.mark.slow
def test_our_training_is_timed(trainee: Trainee) -> None:
    (one,), (two,) = take_turns({"ours": [trainee]}, rounds=2, seconds=0.1)["ours"]
    assert one.frames % (64 * 64) == 0
    assert two.frames > 0
    assert 0 < one.worlds < one.rollout < one.processor


def test_a_trainer_that_dies_says_why() -> None:
    with Trainee(["nobody", "1"], None) as dead:
        dead.begin(0.0)
        with pytest.raises(RuntimeError, match="KeyError: 'nobody'"):
            dead.end()
