"""A kind of origin that the package does not know: a log of real robots, all of it in this file.

It keeps the protocols `Origin` and `Spec`; one row in `ORIGIN_KINDS` makes datasets of it.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from pydantic import Field

from swarmdata.audit import audit
from swarmdata.cards.card import card_of, write_card
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SpecError
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins import ORIGIN_KINDS, Origin, Spec
from swarmdata.specs.recipe import PolicySource, SplitRule, Splits
from swarmdata.specs.spaces import BoxSpace, Space
from swarmdata.store import SPLITS
from swarmdata.testing.synthetic import make_episode
from swarmdata.types import END_REASONS, Episode
from tests.support.made_episodes import stored

N_STEPS = 6


class Hall(Frozen):
    """Robots in a hall: x and y of each from motion capture, two wheel speeds as its action."""

    kind: Literal["hall"] = "hall"
    task: str = "hall_patrol"
    library: str = "our lab"
    robots: tuple[str, ...] = ("anna", "bert")
    rate: float = 20.0  # Hz
    top_speed: float = 2.0

    world: None = None
    horizon: int | None = None
    observation_size: int = 2
    state_size: int = 4
    action_size: int = 2
    action_kind: Literal["continuous"] = "continuous"
    state_meaning: str = "The positions of all robots."
    facts: tuple[tuple[str, str], ...] = (("hall", "building 7"),)
    limits: tuple[str, ...] = ("Motion capture loses a robot now and then.",)

    @property
    def n_agents(self) -> int:
        return len(self.robots)

    @property
    def agent_names(self) -> tuple[str, ...]:
        return self.robots

    @property
    def time_step(self) -> float:
        return 1 / self.rate

    @property
    def action_spaces(self) -> tuple[Space, ...]:
        speed = self.top_speed
        return (BoxSpace(shape=(2,), dtype="float32", low=-speed, high=speed),) * self.n_agents

    def observation_spaces(self, n_columns: int) -> tuple[Space, ...]:
        return (BoxSpace(shape=(n_columns,), dtype="float32"),) * self.n_agents


class RobotLog(Frozen):
    """A log of robots in a hall."""

    kind: Literal["robot_log"] = "robot_log"
    id: str
    tier: str = "field"
    spec: Hall = Hall()
    policies: tuple[PolicySource, ...] = (PolicySource(label="patrol", name="external"),)
    bag: str

    recipe: None = None
    can_rebuild: bool = False
    missing: None = None
    parents: tuple[()] = ()
    has_world_seeds: bool = False
    source_sha256: None = None
    remaking: None = None
    license: str = "mit"
    metadata: Mapping[str, str] = Field(default={"author": "Ada"})
    about_tier: str = "Logged on real robots."

    @property
    def split_rule(self) -> SplitRule:
        return SplitRule(Splits(), seed=3)

    @property
    def source(self) -> str:
        return f"the bag {self.bag}"


LOG: Origin = RobotLog(id="hall_patrol-field-v0", bag="monday.bag")
SPEC: Spec = LOG.spec


@pytest.fixture
def dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Dataset:
    monkeypatch.setitem(ORIGIN_KINDS, "robot_log", RobotLog)
    stored(tmp_path / "ds", LOG, [[logged(seed) for seed in range(20)]])
    write_card(tmp_path / "ds")
    return Dataset.open(tmp_path / "ds", verify="full")


def logged(seed: int) -> Episode:
    """An episode without events, messages, layouts and log-probabilities."""
    random = np.random.default_rng(seed)
    episode = make_episode(N_STEPS, seed, n_values=0, n_obstacles=0, n_features=3, n_states=4)
    positions = random.normal(size=(N_STEPS + 1, 2, 2)).astype(np.float32)
    return replace(
        episode,
        observations=positions,
        states=positions.reshape(-1, 4),
        actions=random.uniform(-2, 2, size=(N_STEPS, 2, 2)).astype(np.float32),
        events=episode.events[..., :0],
        log_probs=episode.log_probs[:, :0],
        end_reason=END_REASONS.index("horizon"),
        terminations=np.zeros(N_STEPS, np.bool_),
        truncations=np.arange(N_STEPS) == N_STEPS - 1,
    )


def test_it_is_stored_and_opened(dataset: Dataset) -> None:
    assert dataset.recipe == LOG
    assert dataset.spec == SPEC
    assert len(dataset) == 20
    assert sorted(np.unique(dataset.episodes.split)) == list(range(len(SPLITS)))
    with pytest.raises(SpecError, match="our lab; stepping or drawing it needs a task"):
        _ = dataset.task


def test_its_actions_are_scaled_for_learning(dataset: Dataset) -> None:
    batch = next(dataset.split("train").sampler(64))
    assert np.abs(batch.actions).max() <= 1
    assert np.abs(dataset.transitions()["actions"]).max() > 1


def test_its_card_describes_it(dataset: Dataset) -> None:
    for line in (
        "license: mit",
        "| environment | `hall_patrol` |",
        "| hall | building 7 |",
        "| hash of the robot_log | `",
        "Logged on real robots.",
        "| author | Ada |",
        "| license | mit |",
        "| code | not given |",
        "| `anna` | box of 2 in [-∞, ∞] | 2 | box of 2 in [-2, 2] | 2 |",
        "States: The positions of all robots.",
        "A step takes 0.05 s.",
        "- Motion capture loses a robot now and then.",
        "Source: the bag monday.bag. This dataset cannot be generated again",
    ):
        assert line in dataset.card, line
    assert dataset.card == card_of(dataset.path)


def test_an_audit_finds_nothing_and_what_is_wrong(dataset: Dataset) -> None:
    found = audit(dataset.path, progress=False)
    assert found.problems == ()
    notes = [each.message for each in found.findings]
    assert any("only datasets generated from recipes claim a tier" in note for note in notes)
    (dataset.path / "card.md").write_text("changed", encoding="utf-8")
    assert [each.check for each in audit(dataset.path, progress=False).problems] == ["card"]


def test_an_unknown_kind_is_read_and_named(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(ORIGIN_KINDS, "robot_log")
    read = Dataset.open(dataset.path)
    assert np.array_equal(read[3].observations, dataset[3].observations)
    with pytest.raises(SpecError, match="origin 'robot_log', which is defined by another package"):
        _ = read.task
