"""A `repr` of a public object fits into a few lines, whatever it holds."""

import inspect
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmdata
from swarmdata.datasets.mixture import mix
from swarmdata.evaluation.results.result_set import group_results
from swarmdata.specs.spaces import BoxSpace

CHARACTERS = 300

LONG = "a-very-long-name" * 8


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory, tiny: Path) -> swarmdata.Dataset:
    """In a folder with a long name, observed through models with long descriptions."""
    folder = tmp_path_factory.mktemp("reprs") / LONG / LONG
    folder.parent.mkdir()
    opened = swarmdata.Dataset.open(shutil.copytree(tiny, folder))
    seen = opened.reobserve("lidar-8+noise-0.05+range-1.5", "lossy-30+range-1.5", progress=False)
    return seen.with_rewards(robot_collision=2.0, time=0.25)


def recorded(n_agents: int) -> swarmdata.RecordedSpec:
    box = BoxSpace(shape=(3,), dtype="float32", low=-1.0, high=1.0).model_dump(mode="json")
    agents = [{"name": f"agent_{k}", "observation": box, "action": box} for k in range(n_agents)]
    content = {"task": "tag_v3", "agents": agents, "state_size": 3, "state_from": "environment"}
    return swarmdata.RecordedSpec.parse(content)


def evaluated(dataset: swarmdata.Dataset) -> swarmdata.EvalResult:
    policy = swarmdata.make_policy("random", "coop_nav")
    return swarmdata.evaluate(policy, dataset.task, name=LONG[:40], n_episodes=2, progress=False)


def provenance() -> swarmdata.Provenance:
    config = {f"{LONG}-{k}": k for k in range(50)}
    return swarmdata.Provenance(label="mine", config=config, run=LONG)


def result(dataset: swarmdata.Dataset) -> swarmdata.Result:
    return swarmdata.Result(evaluated(dataset), provenance(), dataset.task)


def recorder(dataset: swarmdata.Dataset) -> Any:
    env = dataset.make_env(api="pettingzoo")
    return swarmdata.Recorder(
        env, id="coop_nav-mine-v0", path=dataset.path.parent / f"recorded-{LONG}"
    )


PUBLIC: dict[str, Callable[[swarmdata.Dataset], Any]] = {
    "Batch": lambda d: next(d.sampler(4, horizon=3)),
    "Choice": lambda d: swarmdata.Choice(("a", "b")),
    "Dataset": lambda d: d,
    "DatasetInfo": lambda d: swarmdata.list_datasets()[0],
    "Episode": lambda d: d[0],
    "EvalResult": evaluated,
    "FunctionPolicy": lambda d: swarmdata.FunctionPolicy(lambda observations: observations),
    "LogUniform": lambda d: swarmdata.LogUniform(0.1, 1.0),
    "Policy": lambda d: swarmdata.make_policy("scripted", d.task),
    "Provenance": lambda d: provenance(),
    "Recipe": lambda d: d.recipe,
    "RecordedSpec": lambda d: recorded(40),
    "Recorder": recorder,
    "Reference": lambda d: swarmdata.Reference(no_skill=-3.0, expert=6.0),
    "Result": result,
    "Step": lambda d: d.make_env(2).reset(np.arange(2, dtype=np.uint64)),
    "Stream": lambda d: swarmdata.Stream(window=3),
    "SwarmdataError": lambda d: swarmdata.SwarmdataError("a sentence"),
    "TaskRules": lambda d: swarmdata.preset("search").rules,
    "TaskSpec": lambda d: d.task,
}
"""An object of each public class; `StreamedDataset` is in `tests/hub/streaming`."""

REACHED: dict[str, Callable[[swarmdata.Dataset], Any]] = {
    "mixture": lambda d: mix([d, d[:3]]),
    "mixture's sampler": lambda d: mix([d, d[:3]]).sampler(4),
    "sampler": lambda d: d.sampler(4),
    "statistics": lambda d: d.statistics,
    "moments": lambda d: d.moments,
    "stored": lambda d: d.stored,
    "manifest": lambda d: d.stored.manifest,
    "reobservation": lambda d: d.reobservation,
    "reweighting": lambda d: d.reweighting,
    "episodes": lambda d: d.episodes,
    "one episode's row": lambda d: d.episodes[0],
    "columns": lambda d: d.columns("states")[0],
    "world": lambda d: d.make_env(2),
    "world of PettingZoo": lambda d: d.make_env(api="pettingzoo"),
    "task": lambda d: swarmdata.make_task(d.task),
    "frame": lambda d: swarmdata.frame_of(swarmdata.preset("coop_nav-n16")),
    "case": lambda d: group_results([result(d)], is_checked=False).baselines[0],
    "results": lambda d: group_results([result(d)], is_checked=False),
}
"""Objects that public ones lead to."""


def test_every_public_class_is_looked_at() -> None:
    pytest.importorskip("torch", reason="some public classes need torch")
    classes = {name for name in swarmdata.__all__ if inspect.isclass(getattr(swarmdata, name))}
    assert classes == {*PUBLIC, "StreamedDataset"}


@pytest.mark.parametrize("name", [*PUBLIC, *REACHED])
def test_a_repr_is_short(dataset: swarmdata.Dataset, name: str) -> None:
    text = repr({**PUBLIC, **REACHED}[name](dataset))
    assert len(text) <= CHARACTERS, text
    assert "array(" not in text


def test_a_shortened_repr_keeps_both_ends(dataset: swarmdata.Dataset) -> None:
    text = repr(dataset)
    assert text.startswith("<Dataset coop_nav-tiny-v0: seen with observation lidar")
    assert text.endswith(f"{LONG[-20:]}>")
    assert "..." in text
