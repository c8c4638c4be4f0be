"""TaskSpec and Recipe: round trips, hashes, and errors that name the wrong key."""

import json
import sys
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import swarmdata
from swarmdata.errors import SpecError, UnknownNameError
from swarmdata.registry.presets import preset
from swarmdata.registry.recipes import find_recipe
from swarmdata.specs import WORLD_VERSION, frozen
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.specs.rules import Rewards, changed_weights
from swarmdata.specs.task_spec import TaskSpec
from tests.support.own_task import nothing_registered

GOLDEN = Path(__file__).parents[1] / "golden"


@st.composite
def specs(draw: st.DrawFn) -> TaskSpec:
    return TaskSpec.parse(
        {
            "team": [
                {
                    "name": f"r{k}",
                    "count": draw(st.integers(1, 8)),
                    "robot": {"radius": draw(st.floats(0.01, 1))},
                }
                for k in range(draw(st.integers(1, 3)))
            ],
            "horizon": draw(st.integers(1, 1000)),
            "rules": {
                "task": "coop_nav",
                "rewards": {
                    "progress": draw(st.floats(0, 1e6)),
                    "team_share": draw(st.floats(0, 1)),
                },
            },
            "communication": {"kind": "broadcast", "range": draw(st.none() | st.floats(0.1, 10))},
        }
    )


@given(spec=specs())
def test_yaml_and_json_give_the_same_spec_and_hash(spec: TaskSpec) -> None:
    for text in (spec.to_yaml(), spec.to_json()):
        again = TaskSpec.from_text(text)
        assert again == spec
        assert again.hash() == spec.hash() != spec.with_updates(horizon=spec.horizon + 1).hash()


def test_equal_specs_have_one_text_whatever_the_sign_of_a_zero() -> None:
    class Nested(Frozen):
        pair: tuple[float, float] = (-0.0, -1.0)
        table: dict[str, Any]
        rows: list[list[float]]

    signed, plain = (
        Nested.parse({"pair": (zero, 1), "table": {"a": [zero, "-0.0"]}, "rows": [[zero]]})
        for zero in (-0.0, 0.0)
    )
    assert signed == plain
    assert signed.to_json() == plain.to_json()
    assert signed.table["a"][1] == "-0.0"
    shares = [{"task": "coop_nav", "rewards": {"team_share": zero}} for zero in (-0.0, 0.0, "-0.0")]
    assert len({TaskSpec.parse({"rules": rules}).hash() for rules in shares}) == 1
    weights = changed_weights(TaskSpec().rules.rewards, {"team_share": "-0.0"})
    assert str(weights.team_share) == "0.0"


def test_the_hash_of_the_default_is_stable() -> None:
    assert TaskSpec().hash() == json.loads((GOLDEN / "spec.json").read_text())["hash"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "rules: {task: coop_nav, rewards: {progres: 1}}",
            r"rewards.progres: unknown key. Did you mean 'progress'\?",
        ),
        (
            "rules: {task: formaton}",
            r"rules.task: unknown 'formaton'. Did you mean 'formation'\? Known: coop_nav",
        ),
        (
            "observation: {kind: lidar, n_ray: 3}",
            r"observation.lidar.n_ray: unknown key. Did you mean 'n_rays'",
        ),
        ("horizn: 1", r"horizn: unknown key. Did you mean 'horizon'\?"),
        (
            "team: [{robot: {radiuss: 1}}]",
            r"team.0.robot.radiuss: unknown key. Did you mean 'radius'",
        ),
        ("team: [{count: 0}]", r"team.0.count: .*at least 1 \(got 0\)"),
        ("control_dt: 0.05", "at least 2 whole multiples of physics_dt, got 1"),
        (
            "{horizon: 0, rules: {task: coop_nav, rewards: {time: -1}}}",
            "rules.coop_nav.rewards.time: .*; horizon: ",
        ),
        (
            "observation: {kind: lidar, range: 1.0e-20}",
            "observation.lidar.range: 1e-20 is too small, expected at least 1e-12",
        ),
        ("horizon: x", "horizon: expected a whole number"),
        ("horizon: true", "horizon is True, expected a number"),
        ("team: [{count: false}]", "team.0: count is False, expected a number"),
        ("randomization: {mass: [true, 2]}", r"randomization: mass is \[True, 2\], expected a num"),
        ("on_collision: stop", "on_collision: expected 'continue' or 'fail'"),
        ("team: []", "team: expected at least 1 of them, got 0"),
        ("communication: {drop: 1}", "communication: it has no key 'kind'"),
        ("observation: {kind: lidar, landmarks: 1.0}", r"observation\.drift is 0"),
        (
            "{observation: {kind: state, goal_steps: 5}, "
            "communication: {kind: broadcast, payload: pose_and_goal}}",
            "pose_and_goal sends the goal that",
        ),
        ("horizon: 1\nhorizon: 2\n", "'horizon' is given twice"),
    ],
)
def test_errors_name_the_path(text: str, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        TaskSpec.from_text(text)


def test_a_number_that_is_none_is_refused() -> None:
    with pytest.raises(SpecError, match="goal_radius"):
        TaskSpec.parse({"rules": {"task": "coop_nav", "goal_radius": float("nan")}})


def test_recipe_labels_are_unique_and_ids_well_formed() -> None:
    policy = PolicySource(label="a", name="random")
    base = {"id": "coop_nav-random-v1", "tier": "random", "spec": TaskSpec(), "policies": (policy,)}
    assert Recipe.parse(base).n_steps == 1_000_000
    with pytest.raises(SpecError, match="labels must be unique"):
        Recipe.parse({**base, "policies": (policy, policy)})
    with pytest.raises(SpecError, match="id: "):
        Recipe.parse({**base, "id": "../x"})


@pytest.mark.parametrize("value", [5e-05, 1e22, -2.5e-7, 1e-9])
def test_small_and_large_numbers_survive_json_inside_free_tables(value: float) -> None:
    class Table(Frozen):
        values: dict[str, Any]

    table = Table(values={"x": value, "name": "5e-05x"})
    assert Table.from_text(table.to_json()) == table
    assert Table.from_text(table.to_yaml()) == table


def test_a_message_stays_readable_however_much_is_wrong() -> None:
    """Every role with the same long key was told of, each with all the keys that are known."""
    roles = [{"name": f"role_{k}", "robot": {"x" * 200: 1}} for k in range(20)]
    with pytest.raises(SpecError, match=r"; and [0-9]+ more$") as caught:
        TaskSpec.parse({"team": roles})
    assert len(str(caught.value)) < 4000


def test_only_models_that_hide_or_forget_say_so_and_older_specs_keep_their_hashes() -> None:
    plain = TaskSpec.parse({"communication": {"kind": "broadcast"}})
    later = ("goal_steps", "velocities", "ways", "drift", "landmarks", "frame", "max_age")
    assert not [field for field in later if field in plain.to_json()]
    for observation, communication in (
        ({"goal_steps": 0}, {}),
        ({"velocities": False}, {}),
        ({"ways": True}, {}),
        ({"drift": {"heading": 0.1}}, {}),
        ({"drift": {"position": 0.1}, "landmarks": 1.0}, {}),
        ({"frame": "body"}, {}),
        ({}, {"max_age": 0}),
    ):
        changed = TaskSpec.parse(
            {
                "observation": {"kind": "state", **observation},
                "communication": {"kind": "broadcast", **communication},
            }
        )
        assert changed.hash() != plain.hash()
        assert TaskSpec.from_text(changed.to_json()) == changed


def test_only_policies_with_a_convention_write_it_so_that_older_recipes_keep_their_hashes() -> None:
    plain = PolicySource(label="a", name="scripted")
    kept = PolicySource(label="a", name="scripted", convention="keep-left")
    assert "convention" not in plain.model_dump(mode="json")
    assert kept.model_dump(mode="json") == {**plain.model_dump(), "convention": "keep-left"}
    assert plain.hash() != kept.hash()
    assert [PolicySource.from_text(each.to_json()) for each in (plain, kept)] == [plain, kept]


def test_models_may_be_named_as_on_the_command_line() -> None:
    text = "observation: lidar-32+noise-0.05\ncommunication: lossy-30\n"
    spec = TaskSpec.from_text(text)
    assert spec == with_models(TaskSpec(), "lidar-32+noise-0.05", "lossy-30")
    assert TaskSpec.from_text(spec.to_yaml()).hash() == spec.hash()


def test_a_name_modifies_the_models_of_the_spec_that_is_updated() -> None:
    search = preset("search")
    named = search.with_updates(observation="noise-0.05", communication="lossy-30")
    assert named == with_models(search, "noise-0.05", "lossy-30")
    assert named.communication.model_dump()["payload"] == "pose_and_goal"


def test_the_usual_simulator_is_in_no_hash() -> None:
    """Specs that are older than the field keep their hashes, and so do recipes."""
    spec = TaskSpec()
    assert "backend" not in json.loads(spec.to_json())
    assert TaskSpec.from_text("backend: pymunk") == spec
    other = spec.with_updates(backend="mujoco")
    assert json.loads(other.to_json())["backend"] == "mujoco"
    assert TaskSpec.from_text(other.to_yaml()) == other
    assert other.hash() != spec.hash()
    assert with_models(other, backend="pymunk") == spec
    with pytest.raises(SpecError, match=r"backend: expected 'pymunk', 'kinematic' or 'mujoco'"):
        TaskSpec.from_text("backend: bullet")
    with pytest.raises(UnknownNameError, match="Did you mean 'mujoco'"):
        with_models(spec, backend="mujuco")


@pytest.mark.parametrize("version", [0, WORLD_VERSION + 1, 10**12])
def test_a_world_of_another_version_is_refused(version: int) -> None:
    with pytest.raises(SpecError, match=f"world version {version} .* pip install --upgrade"):
        TaskSpec.parse({"version": version})


@pytest.mark.parametrize("rules", [None, dict, Rewards])
def test_a_task_without_a_model_of_its_rules_is_refused(rules: object) -> None:
    with nothing_registered():
        swarmdata.register_task("odd", type("Odd", (), {"Rules": rules}))
        with pytest.raises(SpecError, match=r"`Rules` of task 'odd' .* derives from .*TaskRules"):
            TaskSpec.parse({"rules": {"task": "odd"}})


def test_an_interrupt_is_never_lost_while_a_spec_is_written() -> None:
    """pydantic takes what is raised in a serializer of ours for a wrong kind of a union."""
    recipe = find_recipe("coop_nav-medium")

    def n_calls(interrupted: int | None = None) -> int:
        """Calls of the module's functions, of which one is interrupted."""
        calls = 0

        def count_call(frame: FrameType, event: str, _: object) -> None:
            nonlocal calls
            calls += event == "call" and frame.f_code.co_filename == frozen.__file__
            if calls == interrupted:
                sys.setprofile(None)
                raise KeyboardInterrupt

        sys.setprofile(count_call)
        try:
            recipe.to_json()
        finally:
            sys.setprofile(None)
        return calls

    total = n_calls()
    assert total > 0
    for interrupted in range(1, total + 1):
        with pytest.raises(KeyboardInterrupt):
            n_calls(interrupted)
