"""Timing in turns, and the sections of docs/benchmarks.md and docs/measurements.md."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from swarmdata.registry.presets import preset
from tests.benchmarks.bench_worlds import scanning, team
from tests.benchmarks.engines import Run, physics, swarm, swarm_parallel, timed
from tests.benchmarks.measuring import (
    DOCS,
    HEADS,
    MEASUREMENTS,
    Rate,
    interleave,
    pair,
    short,
    table,
    write_section,
)


@pytest.mark.parametrize(
    ("rate", "text"),
    [(95.12, "95.1"), (999.6, "1k"), (12_345, "12.3k"), (349_900, "350k"), (1_250_000, "1.25M")],
)
def test_rates_have_three_digits(rate: float, text: str) -> None:
    assert short(rate) == text


def test_runs_take_turns_and_the_median_is_of_the_rounds() -> None:
    calls: list[str] = []
    rates = iter([100.0, 1.0, 5.0, 3.0])

    def one(_: float) -> float:
        calls.append("one")
        return next(rates)

    def two(_: float) -> float:
        calls.append("two")
        return 7.0

    found = interleave({"one": one, "two": two}, rounds=3, seconds=0.0)
    assert calls == ["one", "two"] * 4
    assert found == {"one": Rate(3.0, 1.0, 5.0), "two": Rate(7.0, 7.0, 7.0)}  # the first warms up


def test_a_rate_counts_copies() -> None:
    def work(_: int) -> None:
        end = time.process_time() + 0.001
        while time.process_time() < end:
            pass

    run = timed(work, 50)
    assert 20_000 < run(0.05) < 50_000


def test_waiting_does_not_count() -> None:
    assert timed(lambda _: time.sleep(0.002), 1)(0.05) > 2_000


def test_a_pair_is_the_median_of_the_ratios_of_neighbours() -> None:
    ours, other = iter([0.0, 2.0, 6.0, 12.0]), iter([0.0, 1.0, 2.0, 3.0])
    found = pair(lambda _: next(ours), lambda _: next(other), rounds=3, seconds=0.0)
    assert found == Rate(3.0, 2.0, 4.0)


def test_sections_are_replaced_in_place(tmp_path: Path) -> None:
    file = tmp_path / "benchmarks.md"
    for title, body in (("A", "one"), ("B", "two"), ("A", "three")):
        write_section(title, body, tmp_path)
    text = file.read_text(encoding="utf-8")
    assert text.startswith("# Benchmarks\n")
    assert [line for line in text.splitlines() if line.startswith("## ")] == ["## A", "## B"]
    assert "one" not in text.split("## A")[1].split("## B")[0].split()
    assert "three" in text.split("## B")[0]
    assert "two" in text.split("## B")[1]
    before = text
    write_section("B", "two", tmp_path)
    assert file.read_text(encoding="utf-8") == before


def test_what_is_not_speed_has_a_page_of_its_own(tmp_path: Path) -> None:
    write_section("Memory", "one", tmp_path)
    text = (tmp_path / "measurements.md").read_text(encoding="utf-8")
    assert text.startswith("# Measurements\n")
    assert "## Memory\n\none\n" in text


def test_every_section_is_on_its_page() -> None:
    for name in HEADS:
        text = (DOCS / name).read_text(encoding="utf-8")
        assert text.startswith(HEADS[name])
        titles = {line[3:] for line in text.splitlines() if line.startswith("## ")}
        assert titles & set(MEASUREMENTS) == (titles if name == "measurements.md" else set())


def test_a_table_is_markdown() -> None:
    assert table(("a", "b"), [("1", "2")]) == "| a | b |\n| --- | ---: |\n| 1 | 2 |\n"


def test_teams_have_the_same_density() -> None:
    small, large = team(4), team(32)
    assert small == preset("coop_nav")
    area = [spec.arena.width * spec.arena.height / spec.n_agents for spec in (small, large)]
    np.testing.assert_allclose(area[0], area[1], rtol=0.01)
    assert large.obstacles.pockets == 8 * small.obstacles.pockets


@pytest.mark.parametrize(
    "make",
    [
        lambda: swarm(team(4), 3),
        lambda: swarm(scanning(team(4)), 2),
        lambda: swarm_parallel(team(4)),
        lambda: physics(team(4), 2),
    ],
    ids=["copies", "lidar", "parallel", "physics"],
)
def test_engines_run(make: Callable[[], Run]) -> None:
    assert make()(0.01) > 0
