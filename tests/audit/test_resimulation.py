"""Recorded episodes are simulated again, and what differs is named."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from swarmdata.audit import audit, resimulation
from swarmdata.audit.resimulation import replay
from swarmdata.behavior_policies.simple import Random
from swarmdata.datasets.dataset import Dataset
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import STATE_FIELDS, STEP_FIELDS, Episode, Float, Step


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory, record: Callable[..., Path]) -> Dataset:
    out = tmp_path_factory.mktemp("replay") / "d"
    return Dataset.open(record(out, TaskSpec(horizon=20), ("random", "straight")))


def test_the_same_bits_again(dataset: Dataset) -> None:
    assert replay(dataset, 5) == ()
    assert replay(dataset, 10**6) == (), "all of them, where there are fewer"
    assert replay(dataset, 0) == ()


def test_the_choice_is_seeded_and_of_distinct_episodes() -> None:
    first, again, other = (resimulation._choose(50, 9, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert len(np.unique(first)) == 9
    assert first.tolist() != other.tolist()
    assert (np.diff(first) > 0).all()


@pytest.mark.parametrize(
    ("field", "problem"),
    [
        ("states", "states differ from row 3 on"),
        ("actions", "actions differ from row 3 on"),
        ("rewards", "rewards differ from row 3 on"),
        ("seed", "seed is"),
        ("end_reason", "end_reason is"),
    ],
)
def test_a_world_that_has_changed_is_named(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch, field: str, problem: str
) -> None:
    """As after an update of the physics: one episode comes out differently."""
    simulate = resimulation._simulate

    def drifted(*arguments: object) -> list[Episode]:
        first, *rest = simulate(*arguments)  # type: ignore[arg-type]
        value = getattr(first, field)
        if isinstance(value, int):
            changed: Any = value ^ 1
        else:
            changed = value.copy()
            changed[3:] = np.nextafter(changed[3:], np.float32(9))
        return [dataclasses.replace(first, **{field: changed}), *rest]

    monkeypatch.setattr(resimulation, "_simulate", drifted)
    monkeypatch.setattr(resimulation, "provenance", lambda _: {"pymunk": "9.9.9"})
    drifts = replay(dataset, 4)
    assert len(drifts) == len({dataset.episodes.policy[each.episode] for each in drifts})
    assert drifts[0].problem.startswith(problem)
    assert "pymunk 9.9.9 instead of" in str(drifts[0])


def test_another_length_is_a_difference(dataset: Dataset) -> None:
    first = dataset[0]
    cut = {
        name: getattr(first, name)[:-1] for name in (*STATE_FIELDS, *STEP_FIELDS, *first.optional)
    }
    problem = resimulation._difference(first, dataclasses.replace(first, **cut))
    assert problem == "length is 20 in the recording, 19 in the simulation"
    wider = np.zeros((*first.layout.shape, 2), np.float32)
    problem = resimulation._difference(first, dataclasses.replace(first, layout=wider))
    assert problem == "layout differ from row 0 on"


def test_policies_choose_again_on_one_thread(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    act = Random.act
    seen: list[int] = []

    def watched(self: Random, step: Step) -> Float:
        seen.extend(info["num_threads"] for info in threadpool_info())
        return act(self, step)

    monkeypatch.setattr(Random, "act", watched)
    with threadpool_limits(3):
        audit(dataset.path, sample=2, progress=False)
    assert set(seen) == {1}
