"""From a name to one policy: registered ones, tiers, runs, and what has no such policy."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("torch", reason="runs need the torch extra")

import swarmdata
from swarmdata.behavior_policies.learned import Learned
from swarmdata.errors import CheckpointError, PolicyFitError, SpecError, UnknownNameError
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.runs.named_policies import find_opponents
from swarmdata.evaluation.runs.trained_policies import label_of, read_trained
from swarmdata.interfaces import Policy
from swarmdata.registry.presets import preset
from swarmdata.registry.recipes import sources
from swarmdata.runtime.own_components import code_of
from swarmdata.specs.task_spec import TaskSpec
from tests.support.own_task import nothing_registered


@pytest.fixture(scope="module")
def trained(tiny: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Policy]]:
    out = tmp_path_factory.mktemp("runs") / "bc"
    changes = {"n_updates": 2, "hidden": (8,)}
    return out, swarmdata.train("bc", tiny, out, n_seeds=2, changes=changes, progress=False)


def returns(policy: Policy, spec: TaskSpec) -> list[float]:
    found = swarmdata.evaluate(policy, spec, n_episodes=2, progress=False)
    return list(found.metrics["return"])


def test_a_run_gives_the_policy_of_a_seed(trained: tuple[Path, list[Policy]]) -> None:
    folder, policies = trained
    spec = TaskSpec(horizon=40)
    for seed, policy in enumerate(policies):
        assert returns(swarmdata.make_policy(folder, seed=seed), spec) == returns(policy, spec)
    again = swarmdata.make_policy(str(folder), "coop_nav", seed=1)
    assert returns(again, spec) == returns(policies[1], spec)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"seed": 7}, SpecError, "has the seeds 0, 1, got seed 7"),
        ({"noise": 0.1}, SpecError, "takes no options, got noise"),
        ({"spec": "coop_nav-n8"}, PolicyFitError, "4 robots and cannot act with 8"),
    ],
)
def test_what_a_run_has_not_is_refused(
    trained: tuple[Path, list[Policy]], arguments: dict[str, object],
    error: type[Exception], message: str,
) -> None:  # fmt: skip
    with pytest.raises(error, match=message):
        swarmdata.make_policy(trained[0], **arguments)  # type: ignore[arg-type]


def test_a_tier_gives_its_policies() -> None:
    spec = swarmdata.preset("coop_nav")
    expert = swarmdata.make_policy("expert", spec)
    assert isinstance(expert, Learned)
    n = len(sources("coop_nav", "expert", 0.0))
    with pytest.raises(SpecError, match=f"has the seeds 0 to {n - 1}, got seed {n}"):
        swarmdata.make_policy("expert", spec, seed=n)
    with pytest.raises(UnknownNameError, match="unknown policy, tier or run folder 'expret'"):
        swarmdata.make_policy("expret", spec)


def test_a_tier_plays_one_side() -> None:
    evader = swarmdata.make_policy("expert", "tag", side="evader", seed=1)
    play = {"side": "pursuers", "n_episodes": 2, "progress": False}
    here = swarmdata.evaluate("scripted", "tag", opponents=evader, **play)  # type: ignore[arg-type]
    (team,) = find_target("scripted", "tag", side="pursuers", opponents="expert").policies
    first = swarmdata.make_policy("expert", "tag", side="evader")
    named = swarmdata.evaluate("scripted", "tag", opponents=first, **play)  # type: ignore[arg-type]
    whole = swarmdata.evaluate(team, "tag", n_episodes=2, progress=False)
    np.testing.assert_array_equal(named.metrics["time_to_goal"], whole.metrics["time_to_goal"])
    assert (here.metrics["return"] != named.metrics["return"]).all()


@pytest.mark.parametrize(
    ("name", "task", "side", "error", "message"),
    [
        ("expert", "tag", "hunters", UnknownNameError, "unknown side 'hunters'"),
        ("expert", "coop_nav", "team", SpecError, "coop_nav has one side"),
        ("scripted", "tag", "evader", SpecError, "scripted is no tier and takes no side"),
    ],
)
def test_what_plays_no_side_is_refused(
    name: str, task: str, side: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        swarmdata.make_policy(name, task, side=side)


def test_a_registered_policy_needs_a_task(tmp_path: Path) -> None:
    file = tmp_path / "short.yaml"
    file.write_text(TaskSpec(horizon=10).to_yaml())
    scripted = [swarmdata.make_policy("scripted", each) for each in ("coop_nav", file)]
    assert len({type(each) for each in scripted}) == 1
    with pytest.raises(SpecError, match="policy scripted needs a task"):
        swarmdata.make_policy("scripted")
    with pytest.raises(SpecError, match="is not a run folder"):
        swarmdata.make_policy(str(tmp_path), "coop_nav")


def test_worlds_and_tasks_take_names_too() -> None:
    assert swarmdata.make_env("coop_nav").spec == swarmdata.preset("coop_nav")
    assert swarmdata.make_task("formation").spec == swarmdata.preset("formation")
    random = swarmdata.make_policy("random", "coop_nav")
    named = swarmdata.evaluate(random, "coop_nav", n_episodes=2, progress=False)
    assert named.policy == "policy"
    again = swarmdata.evaluate(random, swarmdata.preset("coop_nav"), n_episodes=2, progress=False)
    np.testing.assert_array_equal(named.metrics["return"], again.metrics["return"])


DATASET = "coop_nav-medium-v1"


@given(st.from_regex(r"[a-z_]{1,12}(-[a-z_]{1,6})?", fullmatch=True))
def test_the_dataset_is_no_part_of_the_label(name: str) -> None:
    assert label_of(f"{name}-coop_nav-medium-v1", DATASET) == name
    assert label_of(f"{name}-coop_nav-medium", DATASET) == name
    for other in (f"{name}-coop_nav-expert", "coop_nav-medium", "-coop_nav-medium"):
        assert label_of(other, DATASET) == other


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="is not a run folder"):
        read_trained(tmp_path)


def test_results_against_own_opponents_say_which_code_they_had() -> None:
    tag = preset("tag")
    assert find_opponents("random", "pursuers", tag) == ("random", "random")
    with nothing_registered():
        swarmdata.register_policy("mine", "swarmdata.behavior_policies.simple:Random")
        code = str(code_of("policies", "mine"))
        assert find_opponents("mine", "pursuers", tag) == ("mine", f"mine@{code[:8]}")
