"""Attributes: every array and column is named, and values keep the ranges that they are said."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from swarmdata.interfaces import VecEnv
from swarmdata.registry.components import TASKS, make_env, reward_terms
from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.observation_names import observation_model
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store.arrays.attributes import FRAME_MEANINGS, attributes_of
from swarmdata.store.arrays.layout import FIELDS
from swarmdata.store.arrays.row_shapes import task_row_shapes
from swarmdata.types import EVENTS, Step
from tests.contract.test_tasks import CHANNELS, OBSERVATIONS
from tests.interop.conftest import RECORDING, SPEC
from tests.support.pairs import once_each

WITH_COLUMNS = {
    *("observations", "states", "sent", "actions", "reward_terms", "events", "episodes/layouts")
}


def recipe_of(spec: TaskSpec) -> Recipe:
    policies = (PolicySource(label="a", name="random"),)
    return Recipe(id="some-data-v0", tier="random", spec=spec, policies=policies)


def shapes_of(env: VecEnv) -> dict[str, tuple[int, ...]]:
    """Shapes of the arrays of one episode of 4 steps in this world."""
    step = env.reset(np.zeros(1, dtype=np.uint64))
    n = env.spec.n_agents
    over_states = {
        name: (5, *getattr(step, name).shape[1:])
        for name in ("observations", "states", "sent", "delivered", "ages")
    }
    over_steps = {
        "actions": (4, n, env.action_size),
        "log_probs": (4, n),
        "rewards": (4, n),
        "reward_terms": (4, *step.reward_terms.shape[1:]),
        "terminations": (4,),
        "truncations": (4,),
        "events": (4, n, len(EVENTS)),
    }
    columns = {name: (1,) for name in FIELDS if name.startswith("episodes/")}
    columns["episodes/layouts"] = step.layouts.shape
    return {**over_states, **over_steps, **columns}


def columns_of(attributes: dict[str, Any]) -> Iterator[list[dict[str, Any]]]:
    if "columns" in attributes:
        yield attributes["columns"]
    yield from attributes.get("columns_of_agents", {}).values()


def check(env: VecEnv) -> dict[str, dict[str, Any]]:
    """Every array is described, and every column of those that have some."""
    shapes = shapes_of(env)
    described = attributes_of(recipe_of(env.spec), shapes)
    assert set(described) == set(shapes) == {*FIELDS, "reward_terms"}
    assert json.loads(json.dumps(described, allow_nan=False)) == described
    for name, attributes in described.items():
        assert attributes["meaning"], name
        assert attributes["rows"], name
        groups = list(columns_of(attributes))
        assert bool(groups) == (name in WITH_COLUMNS and shapes[name][-1] > 0), name
        for columns in groups:
            assert len(columns) == shapes[name][-1], name
            assert len({column["name"] for column in columns}) == len(columns), name
            assert all(column["name"] and column["meaning"] for column in columns), name
            assert {column["frame"] for column in columns} <= {"", *FRAME_MEANINGS}, name
            assert {column["unit"] for column in columns} <= {"", "m", "m/s", "rad/s", "s"}, name
    return described


@pytest.mark.parametrize("name", preset_names())
def test_every_column_of_every_preset_is_named(name: str) -> None:
    """Row 44: formation's own columns were "of the task; see its rules", others nothing at all."""
    env = make_env(preset(name))
    check(env)
    shapes, n = task_row_shapes(env.spec), env.spec.n_agents
    assert shapes["observations"] == (n, env.observation_size)
    assert shapes["states"] == (env.state_size,)
    assert shapes["actions"] == (n, env.action_size)
    check_weights(env.task)


def check_weights(task: Any) -> None:
    weights = dict(task.spec.rules.rewards)
    share = weights.pop("team_share")
    terms = reward_terms(task)
    assert {term.name: term.weight for term in terms} == weights
    assert len(terms) == len(weights)
    assert all("weight" in term.formula and term.meaning for term in terms)
    described = attributes_of(recipe_of(task.spec), {"rewards": (4, 4)})["rewards"]
    assert described["team_share"] == share
    assert [term["name"] for term in described["terms"]] == [term.name for term in terms]
    stored = attributes_of(recipe_of(task.spec), {"reward_terms": (4, 4, len(terms))})
    columns = stored["reward_terms"]["columns"]
    assert {c["name"]: c["sign"] * c["weight"] for c in columns} == {
        term.name: term.signed_weight for term in terms
    }


def outside(values: Any, columns: list[dict[str, Any]]) -> list[str]:
    """Columns with a value out of range, but for a rounding of float32."""
    found = []
    for k, column in enumerate(columns):
        low, high = (np.inf if bound is None else bound for bound in column["range"])
        low = -np.inf if low == np.inf else low
        part = np.asarray(values[..., k], dtype=np.float64)
        if part.min() < low - 2e-7 or part.max() > high + 2e-7:
            found.append(f"{column['name']}: {part.min()} to {part.max()}, said {column['range']}")
    return found


def steps_of(env: VecEnv, n_steps: int) -> Iterator[tuple[Step, Any]]:
    """Steps of a world whose robots dash about, with the actions that led to them."""
    rng = np.random.default_rng(0)
    yield env.reset(np.arange(env.n_copies, dtype=np.uint64)), None
    shape = (env.n_copies, env.spec.n_agents, env.action_size)
    for t in range(n_steps):
        if t % 5 == 0:
            actions = np.clip(rng.normal(scale=1.5, size=shape), -1, 1)
        yield env.step(actions), actions


@pytest.mark.parametrize(
    ("task", "observation", "channel"), once_each(tuple(TASKS), OBSERVATIONS, CHANNELS)
)
def test_columns_of_every_model_are_named_and_keep_their_ranges(
    task: str, observation: str, channel: str
) -> None:
    model, radio = observation_model(observation), communication_model(channel)
    env = make_env(preset(task).with_updates(observation=model, communication=radio), 4)
    described = check(make_env(env.spec))
    wrong: list[str] = []
    for step, actions in steps_of(env, 40):
        arrays = {
            "observations": step.observations,
            "states": step.states,
            "sent": step.sent,
            "events": step.events,
            "actions": actions,
            "episodes/layouts": step.layouts,
        }
        for name, values in arrays.items():
            for columns in columns_of(described[name]) if values is not None else ():
                wrong += outside(values, columns)
    assert not wrong


def test_observations_say_in_whose_frame_they_are_and_how_poses_drift() -> None:
    def described(model: str) -> dict[str, Any]:
        spec = preset("coop_nav-unicycle").with_updates(observation=observation_model(model))
        shapes = shapes_of(make_env(spec))
        return attributes_of(recipe_of(spec), shapes)["observations"]

    for model, frame, other in (("state", "world", "body"), ("state+body-frame", "body", "world")):
        found = described(model)
        assert {column["frame"] for column in found["columns"]} == {"", frame}
        assert f"{frame} frame" in found["details"].replace("'s", "")
        assert f"{other} frame" not in found["details"].replace("'s", "")
    drifting = described("drift-0.02")
    assert drifting["model"]["drift"] == dict.fromkeys(("position", "heading", "turning"), 0.02)
    assert "(1 + p B0)" in drifting["details"]
    assert "(1 + p B0)" not in described("noise-0.02")["details"]


def test_what_episodes_draw_is_not_said_to_be_the_specs() -> None:
    ranges = {"max_speed": (0.3, 0.9), "mass": (1.0, 2.0), "noise": (0.0, 0.5)}
    spec = preset("coop_nav-unicycle").with_updates(
        communication=communication_model("perfect"), randomization=ranges
    )
    found = attributes_of(recipe_of(spec), shapes_of(make_env(spec)))
    ahead, turn = (column["meaning"] for column in found["actions"]["columns"])
    assert "0.6 m/s" not in ahead
    assert "the episode's acceleration" in ahead
    assert "3 rad/s" in turn
    assert found["sent"]["columns"][0]["range"] == [None, None]
    assert "draws one deviation for each robot, from 0 to 0.5" in found["observations"]["details"]


def test_robots_that_differ_have_columns_of_their_own() -> None:
    spec = preset("coop_nav-mixed")
    actions = attributes_of(recipe_of(spec), {"actions": (4, spec.n_agents, 2)})["actions"]
    assert "columns" not in actions
    assert list(actions["columns_of_agents"]) == list(spec.agent_names)
    names = {tuple(c["name"] for c in columns) for columns in columns_of(actions)}
    assert len(names) > 1


def test_of_a_foreign_environment_only_what_is_known_is_said() -> None:
    spec = SPEC.model_copy(update={"state_size": 8, "state_from": "observations"})
    shapes = {
        "observations": (5, 2, 5),
        "actions": (4, 2, 2),
        "states": (5, 8),
        "events": (4, 2, 0),
        "rewards": (4, 2),
        "log_probs": (4, 0),
        "episodes/policy": (1,),
    }
    described = attributes_of(RECORDING.model_copy(update={"spec": spec}), shapes)
    columns = {name: s["columns"] for name, s in described["observations"]["spaces"].items()}
    assert columns == {"adversary_0": 5, "agent_0": 3}
    actions = {name: s["space"] for name, s in described["actions"]["spaces"].items()}
    assert actions["adversary_0"] == {"kind": "discrete", "n": 5, "start": 0}
    assert actions["agent_0"]["low"] == -1.0
    assert described["states"]["details"].startswith("All observations")
    assert described["events"]["empty"]
    assert described["episodes/policy"]["codes"] == ["mine"]
    assert not {"terms", "details", "precision"} & set(described["rewards"])
    assert "details" not in described["log_probs"]
    assert not any("step" in attributes for attributes in described.values())


def test_a_width_that_is_not_the_specs_gets_no_columns() -> None:
    described = attributes_of(recipe_of(TaskSpec()), {"states": (5, 3), "observations": (5, 4, 53)})
    assert "columns" not in described["states"]
    assert len(described["observations"]["columns"]) == 53


def test_zarr_reads_them(tiny: Path) -> None:
    """Row 44: array attributes were empty."""
    group: Any = zarr.open_group(tiny / "data.zarr", mode="r")
    names = group["states"].attrs["columns"]
    assert [column["name"] for column in names[:3]] == ["robot_0.x", "robot_0.y", "robot_0.vx"]
    assert all(dict(group[name].attrs)["meaning"] for name in FIELDS)
    codes = group["episodes/split"].attrs["codes"]
    assert [codes[code] for code in np.unique(group["episodes/split"][:])] <= codes
