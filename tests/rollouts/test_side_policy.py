"""A joint policy of a policy for each side, in worlds, in recipes and in datasets."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmdata
from swarmdata.audit import audit
from swarmdata.errors import SchemaError, SpecError, UnknownNameError
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.rollouts.function_policy import FunctionPolicy
from swarmdata.rollouts.recipe_episodes import make_source_policy
from swarmdata.rollouts.side_policy import SidePolicy
from swarmdata.specs.recipe import PolicySource, Recipe
from swarmdata.testing.policy_contract import check_policy
from tests.support.tiny import TINY, make_tiny

SPEC = preset("tag").with_updates(horizon=40)
SEEDS = np.arange(4, dtype=np.uint64)


def composed(pursuers: str, evader: str) -> PolicySource:
    opponent = PolicySource(label="evader", name=evader)
    return PolicySource(label=f"{pursuers}-{evader}", name=pursuers, opponents=(opponent,))


def test_each_side_has_the_actions_of_its_policy() -> None:
    env = make_env(SPEC, 4)
    team = {"pursuers": make_policy("tag-greedy", SPEC), "evader": make_policy("random", SPEC)}
    alone = (make_policy("tag-greedy", SPEC), make_policy("random", SPEC))
    policy, step = SidePolicy(SPEC, team), env.reset(SEEDS)
    for each in (policy, *alone):
        each.reset(step, np.arange(4))
    for _ in range(5):
        actions = policy.act(step)
        greedy, drawn = (each.act(step) for each in alone)
        np.testing.assert_array_equal(actions[:, :3], greedy[:, :3])
        np.testing.assert_array_equal(actions[:, 3:], drawn[:, 3:])
        logs = policy.log_probs(step, actions)
        np.testing.assert_array_equal(logs[:, 3], alone[1].log_probs(step, actions)[:, 3])
        step = env.step(actions)


def test_it_keeps_the_contract() -> None:
    check_policy(make_source_policy(composed("scripted", "random"), SPEC), SPEC, make_env)


def test_a_policy_of_one_side_sees_its_rows_alone() -> None:
    seen = []

    def act(observations: Any) -> Any:
        seen.append(observations)
        return observations[..., :2]

    team = {"pursuers": FunctionPolicy(act), "evader": make_policy("idle", SPEC)}
    policy, step = SidePolicy(SPEC, team, own=("pursuers",)), make_env(SPEC, 4).reset(SEEDS)
    policy.reset(step, np.arange(4))
    actions = policy.act(step)
    np.testing.assert_array_equal(seen[0], step.observations[:, :3])
    np.testing.assert_array_equal(actions[:, :3], np.clip(step.observations[:, :3, :2], -1, 1))
    assert not actions[:, 3].any()


def test_wrong_sides_and_sizes_are_refused() -> None:
    idle = make_policy("idle", SPEC)
    with pytest.raises(UnknownNameError, match="unknown side 'evaders'"):
        SidePolicy(SPEC, {"pursuers": idle, "evaders": idle})
    with pytest.raises(SpecError, match="needs a policy for each side, got pursuers"):
        SidePolicy(SPEC, {"pursuers": idle})
    with pytest.raises(SpecError, match="coop_nav has one side"):
        SidePolicy(preset("coop_nav"), {"team": idle})
    step = make_env(SPEC, 4).reset(SEEDS)
    wrong = SidePolicy(SPEC, {"pursuers": idle, "evader": idle}, own=("evader",))
    with pytest.raises(SchemaError, match=r"of the evader returned .* expected \(4, 1, 2\)"):
        wrong.act(step)


def test_recipes_name_a_policy_for_each_side() -> None:
    source = composed("scripted", "idle")
    recipe = TINY.model_copy(update={"id": "tag-tiny-v0", "spec": SPEC, "policies": (source,)})
    assert Recipe.from_text(recipe.to_json()) == recipe
    assert source.title == "scripted against idle"
    assert "opponents" not in json.loads(PolicySource(label="a", name="idle").to_json())
    for spec, opponents in (("tag", ("pursuers",)), ("coop_nav", ("evader",))):
        named = [PolicySource(label=label, name="idle") for label in opponents]
        policies = [source.model_copy(update={"opponents": tuple(named)}).model_dump()]
        content = {**recipe.model_dump(), "spec": preset(spec).model_dump(), "policies": policies}
        with pytest.raises(SpecError, match=r"has opponents for the sides \w+, expected"):
            Recipe.parse(content)
    nested = {**source.model_dump(), "opponents": [source.model_dump()]}
    with pytest.raises(SpecError, match="has a share or opponents of its own, expected neither"):
        PolicySource.parse(nested)


def test_a_dataset_of_sides_passes_the_audit_and_is_made_again(tmp_path: Path) -> None:
    changes: dict[str, Any] = {
        "id": "tag-tiny-v0",
        "spec": SPEC,
        "policies": (composed("scripted", "random"), composed("random", "scripted")),
        "n_steps": 200,
    }
    first, again = (make_tiny(tmp_path / name, **changes) for name in ("first", "again"))
    assert audit(first, progress=False).problems == ()
    digests = [swarmdata.Dataset.open(folder).digest for folder in (first, again)]
    assert digests[0] == digests[1]


@pytest.mark.slow
def test_generate_takes_a_name_for_each_side(tmp_path: Path) -> None:
    def made(name: str, noise: float) -> swarmdata.Dataset:
        return swarmdata.generate(
            SPEC, name, id="tag-own-v0", n_steps=40, noise=noise, out=tmp_path / "own", workers=1,
            progress=False,
        )  # fmt: skip

    for wrong, error, words in (
        ("scripted,idle,idle", SpecError, "names 3 policies, but tag has the sides pursuers, evad"),
        ("scripted,expert", UnknownNameError, "tier or run folder of a side"),
    ):
        with pytest.raises(error, match=words):
            made(wrong, 0.0)
    with pytest.raises(SpecError, match="none of the policies idle,random has action noise"):
        made("idle,random", 0.1)
    (source,) = made("tag-greedy,random", 0.1).recipe.policies
    assert (source.label, source.name, source.noise) == ("tag-greedy-vs-random", "tag-greedy", 0.1)
    (evader,) = source.opponents
    assert (evader.label, evader.name, evader.noise) == ("evader", "random", 0.0)
