"""What values change in a clone: the ways of departing from it."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("torch", reason="policies need the torch extra")

import swarmdata
from swarmdata.interfaces import Policy
from swarmdata.registry.components import make_env
from swarmdata.rollouts.function_policy import FunctionPolicy
from swarmdata.types import Double, Float, Step
from tests.benchmarks import bench_deviations
from tests.benchmarks.bench_deviations import (
    CLONED,
    HEAD,
    WAYS,
    Departing,
    Pair,
    Way,
    angles,
    measure,
    measured,
    turned,
)
from tests.support.measured import COOP_NAV


def constant(x: float, y: float) -> Policy:
    """A team that always gives the same command."""
    return FunctionPolicy(lambda seen: np.broadcast_to([x, y], (*seen.shape[:2], 2)))


def start(n_copies: int = 3) -> Step:
    return make_env(COOP_NAV, n_copies).reset(np.arange(n_copies, dtype=np.uint64))


def acted(way: Way) -> Float:
    return Departing(constant(0.2, 0.0), constant(0.2, 0.4), way).act(start())


def test_actions_depart_by_a_part_of_the_difference() -> None:
    expected = {"half of the way": 0.2, "all of it": 0.4, "half, away": -0.2}
    assert (acted(CLONED) == np.array([0.2, 0.0], np.float32)).all()
    for way in (way for way in WAYS if not way.is_turned):
        actions = acted(way)
        assert actions.dtype == np.float32
        np.testing.assert_allclose(actions, np.full_like(actions, [0.2, expected[way.name]]))


def test_turned_differences_are_as_long_and_differ_between_robots_and_episodes() -> None:
    (way,) = (way for way in WAYS if way.is_turned)
    difference = acted(way) - np.array([0.2, 0.0], np.float32)
    np.testing.assert_allclose(np.linalg.norm(difference, axis=-1), 0.4, rtol=1e-5)
    directions = np.arctan2(difference[..., 1], difference[..., 0]).ravel()
    assert len(np.unique(directions.round(4))) == directions.size
    assert (acted(way) == acted(way)).all()  # the same in every step of an episode


def test_a_quarter_turn() -> None:
    vectors = np.array([[[1.0, 0.0], [0.0, 2.0]]], np.float32)
    by: Double = np.full((1, 2), math.pi / 2)
    np.testing.assert_allclose(turned(vectors, by), [[[0, 1], [-2, 0]]], atol=1e-7)
    assert ((angles(1, 500) > 0) & (angles(1, 500) < math.tau)).all()


def test_the_distance_is_the_mean_length_of_the_differences() -> None:
    clone = constant(0.0, 0.0)
    pairs = [Pair(clone, constant(0.3, 0.4)), Pair(clone, clone)]
    found = measured(pairs, COOP_NAV, CLONED, 3)
    assert found.scores.shape == (2, 3)
    assert found.distance == pytest.approx(0.25)
    np.testing.assert_array_equal(*found.scores)  # both teams are the clone


def test_a_row_has_differences_to_the_clone(monkeypatch: pytest.MonkeyPatch) -> None:
    clones = constant(0.0, 0.0), constant(0.1, 0.0)
    same = [Pair(clone, clone) for clone in clones]
    monkeypatch.setattr(bench_deviations, "pairs_of", lambda *_: same)
    monkeypatch.setattr(swarmdata, "load", lambda _: SimpleNamespace(spec=COOP_NAV))
    row = measure("some-data", "iql", Path(), 3)
    assert len(row) == len(HEAD)
    assert row[:3] == ("`some-data`", "`iql`", "0.00")
    assert row[4:] == ("+0.0 (0.0 to 0.0)",) * len(WAYS)
