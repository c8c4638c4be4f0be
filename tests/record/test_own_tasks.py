"""A task of this library, recorded through its PettingZoo interface, is the same as generated."""

from pathlib import Path

import numpy as np
import pytest

from swarmdata.envs.world.pettingzoo import ParallelWorld
from swarmdata.errors import SchemaError, SpecError
from swarmdata.record import Recorder
from swarmdata.registry.presets import preset
from swarmdata.specs.model_choice import with_models
from swarmdata.types import STATE_FIELDS, STEP_FIELDS
from tests.support.made_episodes import play

SPEC = with_models(preset("coop_nav"), "lidar", "lossy-30")


def test_it_has_the_same_bits_with_the_same_seeds_and_actions(tmp_path: Path) -> None:
    generated = play(SPEC, 6, "random", 40)
    with Recorder(ParallelWorld(SPEC), id="coop_nav-mine-v0", path=tmp_path / "ds") as recorder:
        for episode in generated:
            recorder.reset(seed=episode.seed)
            for actions in episode.actions:
                recorder.step(dict(zip(recorder.agents, actions, strict=True)))
            assert not recorder.agents
    dataset = recorder.close()
    assert dataset.task == SPEC
    for ours, theirs in zip(dataset, generated, strict=True):
        for name in {*STATE_FIELDS, *STEP_FIELDS, "reward_terms"} - {"log_probs"}:
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), name)
        np.testing.assert_array_equal(ours.layout, theirs.layout)
        assert (ours.seed, ours.end_reason) == (theirs.seed, theirs.end_reason)
        assert ours.optional == ("reward_terms",)
    assert "## Coverage" in dataset.card, "the usual card of the task"
    assert "cannot be generated again" in dataset.card
    assert "## Log-probabilities" not in dataset.card
    seen = dataset.reobserve("state", progress=False)
    assert seen.task.observation != SPEC.observation


def test_what_the_spec_says_is_not_said_again(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"already has .*'horizon'"):
        Recorder(ParallelWorld(SPEC), id="coop_nav-mine-v0", path=tmp_path / "ds", horizon=3)
    with pytest.raises(SchemaError, match="has not been reset"):
        _ = ParallelWorld(SPEC).current_step
