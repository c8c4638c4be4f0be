"""Audits of recordings: what applies is checked, what does not is said."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.building.edit import combine_datasets, filter_dataset
from swarmdata.datasets.dataset import Dataset
from swarmdata.specs.origins import RecordedSpec
from swarmdata.store import EpisodeTable, open_store
from tests.audit.conftest import (
    Arrays,
    Flaw,
    Forge,
    crossing_windows,
    frozen,
    look,
    messages,
    put,
    timeouts_as,
)


def minus_infinity(arrays: Arrays, _: EpisodeTable) -> None:
    arrays["states"][:, 1] = -np.inf


def padded_with_ones(arrays: Arrays, _: EpisodeTable) -> None:
    arrays["observations"][:, 1, 3:] = 1.0


def forbidden_choice(arrays: Arrays, table: EpisodeTable) -> None:
    chosen = int(arrays["actions"][table.starts[1] + 2, 0, 0])
    arrays["action_masks"][table.starts[1] + 1 + 2, 0, chosen] = False


def gone(name: str, after: int, value: object = 1.0) -> Flaw:
    """A value of the first agent of episode 0, so long after it has left."""

    def flaw(arrays: Arrays, table: EpisodeTable) -> None:
        arrays[name][int(table.lengths[0]) // 2 + after, 0] = value

    return flaw


FLAWS: dict[str, tuple[Flaw, str, str]] = {
    "minus infinity": (minus_infinity, "finite", "of states hold NaN or infinities"),
    "padding": (padded_with_ones, "padding", "observations of agent_0 have values in the padding"),
    "half a choice": (put("actions", 0, 7, (0, 0), 2.5), "bounds", "action 2.5 of agent 0"),
    "other bounds": (put("actions", 0, 7, (1, 1), 1.75), "bounds", "a value from -1 to 1.5"),
    "forbidden": (forbidden_choice, "masks", "adversary_0 chose what its mask forbids in 1 steps"),
    "acts": (gone("actions", 1), "leaving", "actions of agents that are gone"),
    "paid": (gone("rewards", 1), "leaving", "rewards of agents that are gone"),
    "seen": (gone("observations", 2), "leaving", "observations of agents that are gone"),
    "ends again": (gone("agent_terminations", 1, True), "leaving", "ends of agents that are gone"),
    "two ways": (
        gone("agent_truncations", 0, True), "leaving", "terminated and truncated, first agent 0"
    ),
    "goes on": (
        put("agent_terminations", 0, 1, (1,), True), "leaving",
        "agents that go on after their end, first agent 1",
    ),
    "leaves silently": (
        lambda arrays, _: arrays["agent_terminations"].fill(False), "leaving",
        "agents that leave without an end, first agent",
    ),
    "frozen state": (frozen("states"), "rows", "states do not change"),
    "reset by itself": (crossing_windows, "boundaries", "transitions cross episodes"),
}  # fmt: skip


@pytest.mark.parametrize("name", FLAWS)
def test_planted_flaw_is_found(name: str, recording: Path, forge: Forge) -> None:
    flaw, check, message = FLAWS[name]
    found = look(forge(recording, flaw))
    assert message in messages(found, check), found.to_text()


def test_a_clean_recording_has_notes_only(recording: Path) -> None:
    found = look(recording)
    assert not found.problems, found.to_text()
    assert {"replay", "teleports", "tiers"} <= {each.check for each in found.findings}


def test_timeouts_as_terminals(recording: Path, long_recording: Path, forge: Forge) -> None:
    """As in OMAR's data: every episode is as long as the horizon, and terminated there."""
    said = messages(look(forge(long_recording, timeouts_as("ended"))), "horizon")
    assert "100% of the 40 terminations come after exactly 12 steps" in said
    origin = open_store(recording).recipe
    assert isinstance(origin.spec, RecordedSpec)
    unknown = origin.model_copy(update={"spec": origin.spec.model_copy(update={"horizon": None})})
    found = look(forge(long_recording, timeouts_as("ended"), unknown))
    assert not messages(found, "horizon")
    assert "look like timeouts" in messages(found, "horizon", "note")
    assert not messages(look(forge(recording, timeouts_as("ended"))), "horizon")  # half end before


def test_longer_than_the_horizon(recording: Path, forge: Forge) -> None:
    origin = open_store(recording).recipe
    short = origin.model_copy(update={"spec": origin.spec.model_copy(update={"horizon": 11})})
    said = messages(look(forge(recording, recipe=short)), "horizon")
    assert "are longer than the horizon of 11 steps" in said


def test_own_recording_is_replayed(own_recording: Path, forge: Forge) -> None:
    found = look(own_recording)
    assert not found.problems, found.to_text()
    assert "random cannot be built, so its choices were not compared: unknown policy" in messages(
        found, "replay", "note"
    )

    def shift(arrays: Arrays, _: EpisodeTable) -> None:
        arrays["rewards"][:] = np.roll(arrays["rewards"], 1, axis=0)

    assert "rewards is" in messages(look(forge(own_recording, shift)), "replay")


def test_a_policy_with_options_that_it_does_not_have(own_recording: Path, forge: Forge) -> None:
    origin = open_store(own_recording).recipe
    policies = tuple(p.model_copy(update={"name": "learned"}) for p in origin.policies)
    mine = forge(own_recording, recipe=origin.model_copy(update={"policies": policies}))
    assert "random cannot be built" in messages(look(mine), "replay", "note")


def test_own_recording_with_other_seeds_is_not_replayed(own_recording: Path, forge: Forge) -> None:
    found = look(
        forge(own_recording, lambda _, table: {"seeds": np.arange(len(table), dtype=np.uint64)})
    )
    assert not messages(found, "replay")
    assert "episodes are not those of their worlds" in messages(found, "replay", "note")


def test_with_recordings_of_other_seeds_only_those_are_not_replayed(
    own_recording: Path, forge: Forge, tmp_path: Path
) -> None:
    """Also in a part of both; and what is wrong in an episode that can be replayed is found."""
    numbered = forge(own_recording, lambda _, table: {"seeds": np.arange(len(table), dtype="u8")})
    views = [Dataset.open(path) for path in (own_recording, numbered)]
    both = combine_datasets(views, tmp_path / "both", id="coop_nav-both-v0")
    part = filter_dataset(both, tmp_path / "part", id="coop_nav-part-v0", split="train")
    for made in (both, part):
        found = look(made.path, sample=1000)
        assert not messages(found, "replay"), found.to_text()
        n = int(np.isin(made.episodes.seeds, views[1].episodes.seeds).sum())
        assert f"the seeds of {n} of {len(made)} replayed" in messages(found, "replay", "note")

    flawed = forge(both.path, put("rewards", 0, 0, (0,), 9.0))
    assert f"1 of {len(both)} replayed" in messages(look(flawed, sample=1000), "replay")


def test_own_recording_without_log_probs_and_events(own_recording: Path, forge: Forge) -> None:
    def less(arrays: Arrays, table: EpisodeTable) -> dict[str, Any]:
        arrays["log_probs"] = arrays["log_probs"][:, :0]
        arrays["events"] = arrays["events"][..., :0]
        none = np.zeros(len(table), dtype=np.int64)
        return {"robot_collisions": none, "obstacle_collisions": none}

    found = look(forge(own_recording, less))
    assert not found.problems, found.to_text()
    assert "log_probs and events were not recorded" in messages(found, "replay", "note")
