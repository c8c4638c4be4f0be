"""Whatever the package does with a task, it does with every task: ours, and one of a user."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

import swarmdata
from swarmdata.audit import audit
from swarmdata.behavior_policies.simple import Idle
from swarmdata.cards.card import card_of
from swarmdata.cards.sections.problem import SINGLE_ROBOT_NOTE, reward_section
from swarmdata.cards.sections.wording import limits_of
from swarmdata.catalogue.build_catalogue import CatalogueChoices, build_catalogue
from swarmdata.envs.render import draw
from swarmdata.errors import SpecError
from swarmdata.evaluation.results.target_evaluation import measure_references
from swarmdata.evaluation.robustness.sweep import plan_sweep, run_sweep
from swarmdata.evaluation.robustness.sweep_axes import parameters, parse_axis
from swarmdata.interfaces import VecEnv
from swarmdata.interop.logs.scored_episodes import check_task as check_logs
from swarmdata.registry.appearance import Appearance
from swarmdata.registry.components import (
    SCRIPTED_CONTROLLERS,
    TASKS,
    appearance_of,
    make_env,
    make_policy,
    make_task,
    resolve,
    reward_terms,
)
from swarmdata.registry.presets import preset
from swarmdata.rollouts.metrics import metrics_of
from swarmdata.specs.budget import size_of
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.origins.log_map import LogMap
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.rules import Payload, TaskDemand, changed_weights, chosen_weights
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.policy_contract import check_policy
from swarmdata.testing.task_contract import check_task
from swarmdata.types import Bool, Float, Int, Step
from tests.catalogue.conftest import little_published
from tests.support.own_task import Thrifty, ThriftyRules, nothing_registered, thrifty_installed
from tests.support.pairs import slow
from tests.support.tiny import make_tiny

OWN = "thrifty"
TASKS_HERE = (*TASKS.own, OWN)

COMMAND = {"components": [{"column": name, "low": -1, "high": 1} for name in "ab"]}
LOGS = {"dt": 0.1, "robots": ["a"], "each": {"log": "a.csv", "time": "t", "command": COMMAND}}


@pytest.fixture(scope="module", params=TASKS_HERE)
def spec(request: pytest.FixtureRequest) -> Iterator[TaskSpec]:
    """A short spec of each task."""
    with thrifty_installed() as own:
        yield (own if request.param == OWN else preset(request.param)).with_updates(horizon=30)


@pytest.fixture(scope="module")
def dataset(spec: TaskSpec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small one of its scripted team."""
    name = f"{spec.task}-uses-v0"
    team = (PolicySource(label="a", name="scripted"),)
    return make_tiny(
        tmp_path_factory.mktemp("uses") / name, id=name, spec=spec, policies=team, n_steps=200
    )


@pytest.fixture
def file(spec: TaskSpec, tmp_path: Path) -> Path:
    """The spec as a file."""
    path = tmp_path / "task.yaml"
    path.write_text(spec.to_yaml())
    return path


@pytest.mark.slow
@pytest.mark.parametrize("spec", [OWN], indirect=True)  # of ours: test_tasks.py
def test_it_keeps_the_contract_in_every_simulator(spec: TaskSpec) -> None:
    check_task(make_env, spec, n_steps=12)
    check_task(make_env, spec.with_updates(backend="kinematic"), n_steps=12)
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    check_task(make_env, spec.with_updates(backend="mujoco"), n_steps=12)


@pytest.mark.parametrize("array", ["times", "events", "states"])
@pytest.mark.parametrize("spec", [OWN], indirect=True)
def test_a_task_that_writes_to_what_is_final_breaks_the_contract(
    spec: TaskSpec, array: str
) -> None:
    def make_forger(spec: TaskSpec, n_copies: int) -> VecEnv:
        env = make_env(spec, n_copies)
        update = env.task.update

        def forge(before: Step, now: Step, active: Bool, solved: Bool) -> None:
            update(before, now, active, solved)
            getattr(now, array)[active] += 1

        env.task.update = forge  # type: ignore[method-assign]
        return env

    with pytest.raises(AssertionError, match=f"wrote to the .*{array}, which are final"):
        check_task(make_forger, spec, n_steps=2)


@pytest.mark.parametrize("spec", [OWN], indirect=True)  # of ours: test_policies.py
def test_its_scripted_team_keeps_the_contract(spec: TaskSpec) -> None:
    check_policy(make_policy("scripted", spec), spec, make_env, n_episodes=2, n_steps=6)


def test_it_takes_no_more_than_its_demand(spec: TaskSpec) -> None:
    for models in (
        (None, None),
        ("state-10+stack-4", "perfect"),
        ("lidar-48+stack-3+delay-2", "state+delayed-3"),
        ("bearing-5", "learned-6"),
        ("occupancy-11", "goal+nearest-2"),
        ("state+ways", "errand"),
    ):
        seen = with_models(spec, *models)
        size, step = size_of(seen), make_env(seen).reset(np.array([1], np.uint64))
        n_observed, n_states = step.observations.shape[2], step.states.shape[1]
        assert n_observed <= size.observation <= 2 * n_observed + 100
        assert n_states <= size.state <= 3 * n_states + 100
        assert step.layouts.shape[1] <= size.obstacles <= step.layouts.shape[1] + 1
        assert step.sent.shape[2] <= size.message


def test_its_rules_are_written_and_read(spec: TaskSpec) -> None:
    assert TaskSpec.from_text(spec.to_yaml()) == TaskSpec.from_text(spec.to_json()) == spec
    with pytest.raises(SpecError, match=rf"rules\.{spec.task}\.raduis: unknown key\. .* Known: "):
        TaskSpec.parse({"rules": {**spec.rules.model_dump(), "raduis": 1}})
    safe = changed_weights(spec.rules.rewards, chosen_weights("safe", spec.rules))
    assert safe.proximity > spec.rules.rewards.proximity


@pytest.mark.parametrize(
    "spec",
    ["transport", OWN, *slow(*(each for each in TASKS.own if each != "transport"))],
    indirect=True,
)
def test_a_dataset_of_it_has_a_card_and_passes_the_audit(spec: TaskSpec, dataset: Path) -> None:
    assert audit(dataset, progress=False).problems == ()
    card = card_of(dataset)
    for name in (*spec.rules.card_limits, *(term.name for term in reward_terms(make_task(spec)))):
        assert name in card


@pytest.mark.parametrize("spec", slow(OWN, "search"), indirect=True)  # tests/catalogue: others
def test_a_catalogue_replays_it(spec: TaskSpec, dataset: Path, tmp_path: Path) -> None:
    with little_published():
        build_catalogue([str(dataset)], tmp_path / "site", CatalogueChoices())
    files = {path.name for path in (tmp_path / "site").rglob("*.js")}
    assert {"episodes.js", "0.js"} <= files


def test_a_picture_shows_it(spec: TaskSpec) -> None:
    pytest.importorskip("PIL", reason="pictures need the plots extra")
    step = make_env(spec).reset(np.array([1], np.uint64))
    assert draw(spec, step.layouts[0], step.states[0], size=64).std() > 0


def test_references_and_metrics_are_measured(spec: TaskSpec, file: Path) -> None:
    found = measure_references(str(file), 2, ("idle", "scripted"), progress=False)
    assert set(found.policies["scripted"]) == set(metrics_of(spec.task))
    assert found.spec_hash == spec.hash()


def test_returns_have_a_score(spec: TaskSpec, dataset: Path) -> None:
    ends = swarmdata.Reference(no_skill=-100.0, expert=100.0)
    opened = swarmdata.Dataset.open(dataset, references=ends)
    scores = opened.normalized_score(opened.episodes.team_return)
    assert np.isfinite(scores).all()


@pytest.mark.slow
@pytest.mark.parametrize("spec", [OWN, *slow("transport")], indirect=True)
def test_its_team_is_swept(spec: TaskSpec, file: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="sweeps draw figures")
    axis = parse_axis("max_speed=0.4..0.6", "body", 2)
    planned = plan_sweep(["scripted"], [axis], tmp_path / "sweep", n_episodes=2, task=str(file))
    (found,) = run_sweep(planned, progress=False)
    assert list((tmp_path / "sweep").glob("*.csv"))
    assert (found.part, found.name) == (axis.part, axis.name)


def test_logs_are_scored_by_it_or_refused(spec: TaskSpec) -> None:
    log_map = LogMap.parse(LOGS)
    words = "the map has 1 robots" if spec.task == "coop_nav" else "more than robots and targets"
    with pytest.raises(SpecError, match=words):
        check_logs(spec, log_map)


@pytest.mark.parametrize("task", TASKS.own)
@pytest.mark.parametrize(("kind", "table"), [("task", TASKS), ("policy", SCRIPTED_CONTROLLERS)])
def test_the_spec_of_another_task_is_refused(task: str, kind: str, table: Any) -> None:
    other = preset("warehouse" if task == "coop_nav" else "coop_nav")
    with pytest.raises(SpecError, match=f"expected '{task}'"):
        resolve(kind, table, task)(other)


class GuidedRules(ThriftyRules):
    """Rules of a task that says all that a task may say."""

    payload_field: ClassVar[str] = "load"
    card_limits: ClassVar[tuple[str, ...]] = ("Everything is known.",)

    task: Literal["guided"] = "guided"  # type: ignore[assignment]
    load: Payload = Payload()

    @property
    def has_own_targets(self) -> bool:
        return True

    def demand(self, spec: TaskSpec) -> TaskDemand:
        return TaskDemand(columns=1, obstacles=7)


class Guided(Thrifty):
    """`thrifty` with a payload, whose scripted team stands still."""

    Rules = GuidedRules
    controller = Idle

    @staticmethod
    def appearance(spec: TaskSpec) -> Appearance:
        return Appearance(legend="Rings are what robots want.")

    def complete(self, states: Float, copies: Int) -> None:
        pass


def test_what_a_users_task_says_of_itself_counts() -> None:
    log_map = LogMap.parse(LOGS)
    with nothing_registered():
        swarmdata.register_task("guided", Guided)
        spec = TaskSpec.parse(
            {"rules": {"task": "guided"}, "randomization": {"payload_mass": [1, 2]}}
        )
        assert isinstance(make_policy("scripted", spec), Idle)
        assert size_of(spec).obstacles == spec.obstacles.number + 7
        assert parameters(spec, "body")["payload_mass"] == (("rules", "load", "mass"),)
        assert limits_of(spec, "own")[-1] == "Everything is known."
        assert SINGLE_ROBOT_NOTE in reward_section(make_task(spec))
        assert appearance_of(spec).legend == "Rings are what robots want."
        with pytest.raises(SpecError, match="the map has 1 robots"):
            check_logs(spec, log_map)
