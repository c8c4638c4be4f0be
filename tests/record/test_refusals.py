"""What a recorder refuses in the step in which it happens, and what is kept then."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box

from swarmdata.audit import audit
from swarmdata.errors import SchemaError, SpecError, UnknownNameError
from swarmdata.record import Limits, Recorder, record_vmas
from swarmdata.record.recording_folder import RecordingFolder, Session
from swarmdata.specs.origins.recording_origin import Recording
from tests.interop.conftest import RECORDING, recorded_episodes
from tests.record.test_vmas import Halving, act
from tests.record.worlds import Choosing, Counting, play, record, steady

ID = "counting_v1-mine-v0"


class Paying(Counting):
    """Pays what it is told in the second step."""

    reward: Any = 1.0

    def step(self, actions: dict[str, Any]) -> tuple[Any, ...]:
        observations, rewards, *rest = super().step(actions)
        if self.time == 2:
            rewards["small"] = self.reward
        return observations, rewards, *rest


class Lingering(Counting):
    """Lists an agent for the rest of the episode, after it was terminated in the second step."""

    def step(self, actions: dict[str, Any]) -> tuple[Any, ...]:
        observations, rewards, ended, cut, infos = super().step(actions)
        ended["small"] = ended.get("small", False) or self.time == 2
        return observations, rewards, ended, cut, infos


class Vanishing(Counting):
    """Takes an agent off its list after the second step, without a word."""

    def step(self, actions: dict[str, Any]) -> tuple[Any, ...]:
        result = super().step(actions)
        if self.time == 2:
            self.agents.remove("small")
        return result


@pytest.mark.parametrize(
    ("reward", "words"),
    [
        (1e39, r"reward of small is not finite: 1e\+39, expected finite float32"),
        (1.7e9 + 0.25, "reward of small has numbers above 16777216, which float32 would round"),
        (1j, "reward of small has values of type complex128"),
        ("1", "reward of small has values of type <U1"),
        ([1.0, 2.0], "expected one number"),
    ],
)
def test_one_bad_reward_costs_its_episode_and_no_other(
    tmp_path: Path, reward: Any, words: str
) -> None:
    env = Paying()
    recorder = Recorder(env, id=ID, path=tmp_path / "ds", limits=Limits(episodes=5))
    play(recorder, 7, steady)
    env.reward = reward
    with pytest.raises(SchemaError, match=words):
        play(recorder, 1, steady)
    env.reward = 1.0
    play(recorder, 5, steady)
    assert recorder.close().n_episodes == 12


@pytest.mark.parametrize("choice", [7, -1, 2.5])
def test_a_choice_that_does_not_exist_is_refused_before_the_step(
    tmp_path: Path, choice: float
) -> None:
    recorder = Recorder(Choosing(), id="choosing_v2-mine-v0", path=tmp_path / "ds")
    recorder.reset()
    good = {agent: recorder.action_space(agent).sample() for agent in recorder.agents}
    with pytest.raises(SchemaError, match=r"action of one is .* expected a whole number from 0 to"):
        recorder.step({**good, "one": choice})
    with pytest.raises(SchemaError, match=r"action of mixed is .* column 0, expected a whole"):
        recorder.step({**good, "mixed": {"gear": choice, "speed": np.ones(1)}})
    while recorder.agents:  # the same episode goes on
        recorder.step(good)
    play(recorder, 3)
    assert recorder.close().n_episodes == 4


def test_an_agent_that_is_listed_after_its_end_has_left(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="small got the reward 3.0 after its end") as caught:
        dataset = record(Lingering(length=6), tmp_path / "ds", act=steady)
    assert len(caught) == 1
    alive, ends = dataset[0].alive, dataset[0].agent_terminations
    assert alive is not None
    assert ends is not None
    assert alive[:, 1].tolist() == [True, True, False, False, False, False, False]
    assert ends[:, 1].tolist() == [False, True, False, False, False, False]
    assert not dataset[0].rewards[2:, 1].any()
    assert not [each for each in audit(dataset.path, progress=False).problems
                if each.check in ("ends", "leaving", "bounds")]  # fmt: skip


def test_an_agent_that_vanishes_without_a_flag_is_refused(tmp_path: Path) -> None:
    recorder = Recorder(Vanishing(), id=ID, path=tmp_path / "ds")
    with pytest.raises(SchemaError, match=r"agents \['small'\] are no longer in `agents`"):
        play(recorder, 1, steady)


@pytest.mark.parametrize("kind", ["observation", "action"])
def test_spaces_without_a_number_are_refused_at_once(tmp_path: Path, kind: str) -> None:
    env = Counting()
    setattr(env, f"{kind}_space", lambda agent: Box(-1.0, 1.0, (0,), np.float32))
    with pytest.raises(SpecError, match=f"no agent has a number in its {kind}"):
        Recorder(env, id=ID, path=tmp_path / "ds")
    assert list(tmp_path.iterdir()) == []


def test_a_batch_that_goes_wrong_keeps_the_episodes_before(tmp_path: Path) -> None:
    path, calls = tmp_path / "ds", 0

    def failing(observations: list[Any]) -> list[Any]:
        nonlocal calls
        calls += 1
        given = act(observations)
        if calls == 6:
            given[1][2] = 3.0  # the third copy
        return given

    options: dict[str, Any] = {"id": "halving-mine-v0", "path": path, "task": "halving"}
    with pytest.raises(SchemaError, match="action of b is 3 in column 0 of step"):
        record_vmas(Halving(), failing, 12, **options)
    assert record_vmas(Halving(), act, 12, **options).n_episodes == 12
    assert calls == 10, "five steps for each of two batches"


def test_a_part_that_cannot_be_written_takes_nothing_with_it(tmp_path: Path) -> None:
    """What is added later is not lost in the name of a part that was written before."""
    good, bad = recorded_episodes([3, 4, 5, 2]), recorded_episodes([3])[0]
    folder = RecordingFolder(tmp_path / "ds")
    policies = (*RECORDING.policies, RECORDING.policies[0].model_copy(update={"label": "other"}))
    recording: Recording = RECORDING.model_copy(update={"policies": policies})
    folder.claim(Session(recording=recording, log_probs=False, masks=True))
    object.__setattr__(bad, "policy", 1)
    object.__setattr__(bad, "rewards", bad.rewards * np.float32(np.nan))
    folder.add(good[0])
    folder.add(bad)
    for episode in good[1:]:
        with pytest.raises(SchemaError, match="not finite"):
            folder.flush()
        folder.add(episode)
    with pytest.raises(SchemaError, match="not finite"):
        folder.flush()
    folder.release()
    again = RecordingFolder(tmp_path / "ds")
    assert again.n_episodes == 4
    again.release()


def test_another_source_of_states_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="Known: auto, environment, observations"):
        Recorder(Counting(), id=ID, path=tmp_path / "out", state="env")  # type: ignore[arg-type]
