"""Every check finds the flaw that it is for, in datasets that are otherwise in order."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from threadpoolctl import threadpool_info, threadpool_limits

from swarmdata.audit import CHECKS, audit, problems_of
from swarmdata.audit.claim_checks import tiers
from swarmdata.behavior_policies.simple import Random
from swarmdata.cards.card import write_card
from swarmdata.errors import MissingManifestError
from swarmdata.hub.catalog.catalog import load
from swarmdata.numerics.random import EVALUATION_BASE
from swarmdata.registry.presets import preset
from swarmdata.registry.published import published
from swarmdata.registry.recipes import find_recipe
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import Robot, Role
from swarmdata.store import EpisodeTable, open_store, read_manifest
from swarmdata.store.arrays.layout import CARD, MANIFEST, REFERENCES, array_file, metadata_file
from swarmdata.store.arrays.shards import file_digest
from swarmdata.types import END_REASONS, Float, Step
from tests.audit.conftest import (
    Arrays,
    Flaw,
    Forge,
    crossing_windows,
    final_rows,
    frozen,
    look,
    messages,
    put,
    timeouts_as,
)
from tests.support.tiny import flip, sign

SUCCESS, HORIZON = (END_REASONS.index(reason) for reason in ("success", "horizon"))


def columns(name: str, change: Callable[[Any], Any]) -> Flaw:
    """Another column of the table."""
    return lambda _, table: {name: change(getattr(table, name))}


def both_flags(value: bool) -> Flaw:
    """At the end of the first episode."""

    def flaw(arrays: Arrays, table: EpisodeTable) -> None:
        for name in ("terminations", "truncations"):
            arrays[name][table.lengths[0] - 1] = value

    return flaw


def timeouts_as_terminals(arrays: Arrays, _: EpisodeTable) -> None:
    arrays["terminations"] |= arrays["truncations"]
    arrays["truncations"][:] = False


def other_weights(arrays: Arrays, table: EpisodeTable) -> None:
    row = table.starts[2] + 3
    arrays["rewards"][row, 1] = np.nextafter(arrays["rewards"][row, 1], np.float32(9))


def uncounted_contact(arrays: Arrays, table: EpisodeTable) -> None:
    arrays["events"][table.starts[1] + 2, 0, 0] ^= 1


def copied_episode(arrays: Arrays, table: EpisodeTable) -> dict[str, Any]:
    """The content of the first test episode is that of a train episode of the same length."""
    test = int(np.flatnonzero(table.split == 2)[0])
    train = int(np.flatnonzero((table.split == 0) & (table.lengths == table.lengths[test]))[0])
    for name, array in arrays.items():
        if not name.startswith("episodes/"):
            extra = len(array) > len(arrays["actions"])
            rows = [np.arange(table.lengths[k] + extra) + table.starts[k] + k * extra
                    for k in (test, train)]  # fmt: skip
            array[rows[0]] = array[rows[1]]
    return {"split": table.split}


def missing_copy(arrays: Arrays, table: EpisodeTable) -> None:
    """Two distinct rows, as D4RL's positions: every row is that of a buffer at its end."""
    first = table.starts + np.arange(len(table))
    states = arrays["states"]
    states[:] = states[-1]
    states[first] = states[first[0]] + 0.001


def repeated_last_row(arrays: Arrays, table: EpisodeTable) -> None:
    arrays["observations"][final_rows(table)] = arrays["observations"][final_rows(table) - 1]


def teleport(arrays: Arrays, table: EpisodeTable) -> None:
    arrays["states"][table.starts[2] + 2 + 7, 8] += 0.5


def late_rewards(arrays: Arrays, _: EpisodeTable) -> None:
    arrays["rewards"][:] = np.roll(arrays["rewards"], 1, axis=0)


def invented_successes(_: Arrays, table: EpisodeTable) -> dict[str, Any]:
    return {
        "success": np.ones_like(table.success),
        "end_reason": np.full_like(table.end_reason, SUCCESS),
    }


def one_bit_of(name: str) -> Flaw:
    def flaw(arrays: Arrays, table: EpisodeTable) -> None:
        row = arrays[name][table.starts[0] + 3]
        words = row.reshape(-1).view(f"u{row.dtype.itemsize}")
        words[0] ^= 1

    return flaw


WRONG_RETURN = columns("team_return", lambda mean: mean + 1e-4)
EVALUATION_SEEDS = columns("seeds", lambda seeds: seeds + np.uint64(EVALUATION_BASE))

FLAWS: dict[str, tuple[Flaw, str, str]] = {
    "nan": (
        put("states", 2, 5, (1,), np.nan), "finite", r"1 of .* of states .* \(episode 2, step 5\)"
    ),
    "loud action": (
        put("actions", 1, 3, (2, 1), 1.5), "bounds",
        "1.5 of agent 2, component 1, in episode 1, step 3",
    ),
    "flag in the middle": (
        put("truncations", 3, 2, (), True), "ends", "inside episodes, first episode 3, step 2"
    ),
    "no end": (both_flags(False), "ends", "1 episodes have no end, first episode 0"),
    "ended twice": (both_flags(True), "ends", "1 steps are terminated and truncated"),
    "timeouts as terminals": (timeouts_as_terminals, "ends", "flags and end reasons disagree"),
    "timeouts as failures": (timeouts_as("failure"), "horizon", r"100% .* after exactly 20 steps"),
    "wrong return": (WRONG_RETURN, "table", "team_return of episodes 0, 1, 2 and"),
    "other weights": (
        other_weights, "rewards", "reward of agent 1 in episode 2, step 3 is .* its terms",
    ),
    "uncounted contact": (
        uncounted_contact, "rewards", "term robot_contact of agent 0 in episode 1, step 2 is",
    ),
    "uncounted collisions": (
        columns("obstacle_collisions", lambda n: n + 1), "table",
        "obstacle_collisions of episodes 0",
    ),
    "same seed twice": (
        columns("seeds", lambda seeds: np.concatenate([seeds[:1], seeds[:-1]])), "seeds",
        "1 episodes repeat the seed of another.*episodes 0",
    ),
    "evaluation seed": (EVALUATION_SEEDS, "seeds", "reserved for evaluation"),
    "seeds of another recipe": (EVALUATION_SEEDS, "seeds", "not of this recipe"),
    "reversed streams": (
        columns("policy_episode", lambda order: order[::-1].copy()), "order",
        "not in the order of their stream",
    ),
    "other splits": (
        columns("split", lambda split: np.roll(split, 1)), "splits", "the rule assigns episodes"
    ),
    "copied episode": (copied_episode, "duplicates", "1 of them across splits: first .*(test)"),
    "missing copy": (missing_copy, "rows", "states do not change in episodes 0, 1, 2"),
    "distinct rows": (missing_copy, "rows", "of the rows of states are distinct"),
    "frozen observations": (frozen("observations"), "rows", "observations do not change"),
    "crossing windows": (crossing_windows, "boundaries", "transitions cross episodes"),
    "repeated last row": (repeated_last_row, "boundaries", "last row .* copy of the one before"),
    "teleport": (teleport, "teleports", r"robot 1 moves 0\.\d+ m in episode 2, step [67]"),
    "late rewards": (late_rewards, "replay", r"4 of 4 .* episode 0, step 0, agent 0: rewards is"),
    "a state's bit": (one_bit_of("states"), "replay", "episode 0, step 3: states is"),
    "an arrival's bit": (one_bit_of("delivered"), "replay", "step 3, agent 0: delivered is"),
    "an action's bit": (one_bit_of("actions"), "replay", "step 3, agent 0: actions is"),
    "an invented success": (
        invented_successes, "replay", f"episodes/end_reason is {SUCCESS}, replayed {HORIZON}"
    ),
}  # fmt: skip


def test_a_clean_dataset_has_no_findings(clean: Path) -> None:
    found = look(clean, sample=100)
    assert found.findings == ()
    assert problems_of(clean) == ()
    assert found.checks == tuple(CHECKS)
    assert found.digest == open_store(clean).manifest.digest
    assert found.to_text() == (
        f"coop_nav-small-v0 (digest {found.digest[:12]}): {len(CHECKS)} checks, no problems\n"
    )


@pytest.mark.parametrize("name", FLAWS)
def test_planted_flaw_is_found(name: str, clean: Path, forge: Forge) -> None:
    flaw, check, message = FLAWS[name]
    found = look(forge(clean, flaw), sample=4 if check == "replay" else 0)
    assert re.search(message, messages(found, check)), found.to_text()


def test_a_slow_robot_may_be_pushed_by_a_fast_one(clean: Path, forge: Forge) -> None:
    def pushed(arrays: Arrays, table: EpisodeTable) -> None:
        arrays["states"][table.starts[2] + 2 + 7 :, 8] += 0.14

    origin = open_store(clean).recipe
    assert isinstance(origin, Recipe)
    fast = Role(name="fast", count=1, robot=Robot(max_speed=1.6))
    team = (Role(name="slow", count=3, robot=Robot()), fast)
    mixed = origin.model_copy(update={"spec": origin.spec.with_updates(team=team)})
    assert "robot 1 moves" in messages(look(forge(clean, pushed), sample=0), "teleports")
    assert not messages(look(forge(clean, pushed, mixed), sample=0), "teleports")


def test_every_check_has_a_planted_flaw() -> None:
    elsewhere = {
        "integrity", "identity", "shapes", "padding", "masks", "statistics", "leaving", "tiers",
        "card", "attributes",
    }  # fmt: skip
    assert {check for _, check, _ in FLAWS.values()} | elsewhere == set(CHECKS)


@pytest.mark.slow
@settings(
    max_examples=2,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(data=st.data())
def test_any_changed_bit_of_any_array_is_found(
    data: st.DataObject, clean: Path, forge: Forge
) -> None:
    """The bytes are signed again, so that only their meaning can give the change away."""

    def flip(arrays: Arrays, _: EpisodeTable) -> None:
        names = sorted(n for n, a in arrays.items() if a.size and "/" not in n and a.dtype != bool)
        array = arrays[data.draw(st.sampled_from(names))]
        data_bytes = array.reshape(-1).view(np.uint8)
        position = data.draw(st.integers(0, len(data_bytes) - 1))
        data_bytes[position] ^= 1 << data.draw(st.integers(0, 7))

    assert "replay" in {each.check for each in look(forge(clean, flip), sample=100).problems}


EXTREMES = {"f": (np.nan, np.inf, -1e30, 3e38, -0.0), "i": (-1, 1 << 40), "u": (255,), "b": (True,)}


@settings(
    max_examples=3,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(data=st.data())
def test_whatever_can_be_opened_can_be_audited(
    data: st.DataObject, clean: Path, forge: Forge
) -> None:
    """Extreme values anywhere, as a careless conversion leaves them: findings, and no crash."""

    def spoil(arrays: Arrays, table: EpisodeTable) -> dict[str, Any]:
        names = sorted(n for n, a in arrays.items() if a.size and "/" not in n)
        for name in data.draw(st.lists(st.sampled_from(names), max_size=3)):
            array = arrays[name].reshape(-1)
            values = EXTREMES[array.dtype.kind]
            if name in ("observations", "rewards"):  # statistics of them must be finite
                values = (-1e30, -0.0)
            place = data.draw(st.integers(0, len(array) - 1))
            array[place : place + data.draw(st.sampled_from([1, len(array)]))] = data.draw(
                st.sampled_from(values)
            )
        columns = ["seeds", "policy_episode", "team_return", "robot_collisions", "layouts"]
        changed = {}
        for name in data.draw(st.lists(st.sampled_from(columns), max_size=2)):
            column = getattr(table, name).copy()
            column[data.draw(st.integers(0, len(table) - 1))] = data.draw(
                st.sampled_from(EXTREMES[column.dtype.kind])
            )
            changed[name] = column
        return changed

    assert look(forge(clean, spoil), sample=3).problems  # at least: it has no card


def test_flipped_byte_of_a_file(clean: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(clean, tmp_path / "damaged"))
    file = folder / array_file("rewards", 2)
    flip(file, 10)
    assert str(file) in messages(look(folder), "integrity")


def test_no_manifest_cannot_be_audited(clean: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(clean, tmp_path / "unfinished"))
    (folder / "manifest.json").unlink()
    with pytest.raises(MissingManifestError):
        look(folder)


def test_statistics_of_the_whole_dataset(clean: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(clean, tmp_path / "leaky"))
    stored = open_store(folder)
    mean = float(stored.arrays["rewards"].mean(dtype=np.float64))
    statistics = stored.manifest.statistics.model_copy(update={"reward_mean": mean})
    changed = stored.manifest.model_copy(update={"statistics": statistics})
    (folder / MANIFEST).write_bytes(changed.to_bytes())
    assert "mean of rewards, column 0, is" in messages(look(folder), "statistics")


def test_arrays_of_another_spec(clean: Path, forge: Forge) -> None:
    origin = open_store(clean).recipe
    assert isinstance(origin, Recipe)
    lidar = origin.spec.with_updates(observation={"kind": "lidar"})
    found = look(forge(clean, recipe=origin.model_copy(update={"spec": lidar})))
    assert "observations has rows of shape" in messages(found, "shapes")
    assert [f.message for f in found.findings if f.check == "replay"] == [
        "not checked, because of shapes"
    ]


def test_missing_episodes(clean: Path, forge: Forge) -> None:
    origin = open_store(clean).recipe
    assert isinstance(origin, Recipe)
    more = origin.model_copy(update={"n_steps": origin.n_steps + 10_000})
    found = look(forge(clean, recipe=more))
    assert "which has no more episodes here" in messages(found, "order")


def test_id_that_is_published_of_something_else(clean: Path, forge: Forge) -> None:
    origin = open_store(clean).recipe.model_copy(update={"id": "coop_nav-random-v1"})
    found = look(forge(clean, recipe=origin))
    assert "Give it another id or version" in messages(found, "identity")


def test_card_that_says_something_else(clean: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(clean, tmp_path / "typed"))
    text = (folder / CARD).read_text()
    line = next(k for k, each in enumerate(text.splitlines()) if "joint steps" in each) + 1
    (folder / CARD).write_text(text.replace("joint steps |", "joint steps | about", 1))
    assert f"line {line} of card.md is '| joint steps | about" in messages(look(folder), "card")
    (folder / CARD).unlink()
    assert "there is no card.md" in messages(look(folder), "card")


def relabel(folder: Path, name: str, change: Callable[[dict[str, Any]], None]) -> None:
    """Changes an array's Zarr attributes and signs the manifest again."""
    file = folder / metadata_file(name)
    metadata = json.loads(file.read_bytes())
    change(metadata["attributes"])
    file.write_text(json.dumps(metadata))
    content = json.loads((folder / MANIFEST).read_bytes())
    entry = {"size": file.stat().st_size, "sha256": file_digest(file)}
    content["files"][metadata_file(name)] = entry
    sign(folder, content)


def test_attributes_that_lie(clean: Path, tmp_path: Path) -> None:
    """Row 44: who reads with Zarr alone believes them."""
    folder = Path(shutil.copytree(clean, tmp_path / "lies"))
    assert not messages(look(folder), "attributes")
    relabel(folder, "rewards", lambda a: a["terms"][0].update(weight=9.0))
    relabel(folder, "states", lambda a: a["columns"][0].update(unit="cm"))
    found = look(folder)
    assert "attributes of ['rewards', 'states'] were changed" in messages(found, "attributes")
    assert open_store(folder, "full"), "readers of ours do not use them"


def test_datasets_without_attributes_are_older(clean: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(clean, tmp_path / "older"))
    for name in read_manifest(folder).arrays:
        relabel(folder, name, lambda attributes: attributes.clear())
    found = look(folder)
    notes = [each.message for each in found.findings if each.check == "attributes"]
    assert notes == ["its arrays have no Zarr attributes: an older version of swarmdata wrote it"]
    assert not messages(found, "attributes")
    assert open_store(folder, "full").table.success.shape


@pytest.mark.slow
def test_references_that_say_something_else(random_team: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(random_team, tmp_path / "typed"))
    write_card(folder)
    assert not messages(look(folder), "card")
    (folder / REFERENCES).write_text("{}")
    assert "references.json differs from this version's" in messages(look(folder), "card")
    (folder / REFERENCES).unlink()
    assert "references.json is absent" in messages(look(folder), "card")


@pytest.fixture(scope="module")
def random_team(tmp_path_factory: pytest.TempPathFactory, record: Callable[..., Path]) -> Path:
    """Random robots in the task that references are measured for."""
    folder = tmp_path_factory.mktemp("tiers") / "random"
    record(folder, preset("coop_nav"), ("random",), tier="random")
    return folder


@pytest.mark.slow
def test_swapped_tiers(random_team: Path, forge: Forge) -> None:
    assert not messages(look(random_team), "tiers")
    for tier in ("medium", "expert"):
        origin = open_store(random_team).recipe.model_copy(update={"tier": tier})
        said = messages(look(forge(random_team, recipe=origin), sample=1), "tiers")
        assert f"is nearest to random, not to {tier}" in said
        assert f"success of this {tier} is 0.000, expected" in said


@pytest.mark.parametrize(
    ("tier", "ends", "inside", "outside"),
    [
        ("medium-replay", "random and medium", -6.0, (-30.0, 5.0)),
        ("medium-expert", "medium and expert", 4.0, (0.0, 9.0)),
    ],
)
def test_mixtures_lie_between_their_parts(
    tier: str, ends: str, inside: float, outside: tuple[float, ...], random_team: Path, forge: Forge
) -> None:
    """D4RL's hopper-medium-replay-v1 was better than medium."""
    origin = open_store(random_team).recipe.model_copy(update={"tier": tier})

    def said_of(mean: float, success: bool = False) -> str:
        def pay(arrays: Arrays, table: EpisodeTable) -> dict[str, Any]:
            arrays["rewards"][:] = np.float32(mean / table.lengths.mean())
            ends = END_REASONS.index("success" if success else "horizon")
            reasons = np.full_like(table.end_reason, ends)
            return {"success": np.full_like(table.success, success), "end_reason": reasons}

        return messages(look(forge(random_team, pay, origin), sample=0), "tiers")

    assert not said_of(inside)
    assert f"is not between {ends}" in said_of(min(outside))
    assert "is not between" not in said_of(min(outside), success=True), "they collide more"
    assert "is not between" not in said_of(max(outside), success=False), "or less"
    assert f"is not between {ends}" in said_of(max(outside), success=True)


@pytest.mark.parametrize("dataset", published())
def test_no_published_dataset_is_refused_for_its_tier(dataset: str) -> None:
    recipe, known = find_recipe(dataset), published()[dataset]
    table = SimpleNamespace(
        team_return=np.array([known.mean_return]), success=np.array([known.success])
    )
    origin = SimpleNamespace(recipe=recipe, tier=recipe.tier, spec=recipe.spec)
    found = tiers(SimpleNamespace(origin=origin, table=table))  # type: ignore[arg-type]
    assert [message for level, message in found if level == "problem"] == []


def test_policies_choose_again_on_one_thread(clean: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    act = Random.act
    seen: list[int] = []

    def watched(self: Random, step: Step) -> Float:
        seen.extend(info["num_threads"] for info in threadpool_info())
        return act(self, step)

    monkeypatch.setattr(Random, "act", watched)
    with threadpool_limits(3):
        audit(clean, sample=2, progress=False, only=("replay",))
    assert set(seen) == {1}


def test_actions_of_another_policy(random_team: Path, forge: Forge) -> None:
    """The arrays of one dataset under the recipe of another: seeds and choices give it away."""
    origin = open_store(random_team).recipe
    assert isinstance(origin, Recipe)
    policies = (origin.policies[0].model_copy(update={"name": "straight"}),)
    other = origin.model_copy(update={"policies": policies, "seed": 9})
    found = look(forge(random_team, recipe=other))
    assert "not of this recipe" in messages(found, "seeds")
    assert "actions is" in messages(found, "replay")


def test_a_recipe_whose_policy_cannot_be_built(clean: Path, forge: Forge) -> None:
    origin = open_store(clean).recipe
    lost = {"name": "learned", "checkpoint": "lost.safetensors", "sha256": "0" * 64}
    policies = (origin.policies[0], origin.policies[1].model_copy(update=lost))
    mine = forge(clean, recipe=origin.model_copy(update={"policies": policies}))
    said = messages(look(mine), "replay")
    assert "straight cannot be built, so its choices were not compared: cannot read" in said


def test_findings_as_text_and_json(clean: Path, forge: Forge) -> None:
    found = look(forge(clean, WRONG_RETURN))
    assert "problem: table: team_return of" in found.to_text()
    assert f"{len(CHECKS)} checks, {len(found.problems)} problem" in found.to_text()
    content = json.loads(found.to_json())
    assert content["n_problems"] == len(found.problems)
    assert content["findings"][0] == asdict(found.findings[0])


@pytest.mark.slow
def test_a_published_mini_is_clean() -> None:
    dataset = load("coop_nav-random-mini", progress=False)
    assert audit(dataset.path, progress=False).findings == ()
