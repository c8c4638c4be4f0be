"""Views in which robots must hear or remember, by clones that act in them.

A clone is the least-squares map from a robot's features to its command. Robots of these views
observe no velocities: with them, a clone of a robot that knows no goal fits nearly as well as one
of a robot that does, since commands go on as they were, but it does not know where to start.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from swarmdata.datasets.reobservation import RecordedEpisodes, observe_episodes
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_env, make_policy, make_task
from swarmdata.registry.presets import preset
from swarmdata.rollouts.evaluate import evaluate
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.features import Feature
from swarmdata.specs.model_choice import with_models
from swarmdata.types import Double, Episode, Float, Int, Step

pytestmark = pytest.mark.learns

NEAR = 0.3  # m, below which the direction of a vector shrinks

SEEN = "state+no-velocities"

HIDDEN = "state+goal-for-0+no-velocities"


def inputs(features: tuple[Feature, ...], observations: Float) -> Double:
    """The features, their vectors at unit length, and a constant."""
    values = observations.astype(np.float64)
    vectors = [values[..., k : k + 2] for k, feature in enumerate(features) if feature.axis == "x"]
    units = [v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), NEAR) for v in vectors]
    return np.concatenate([values, *units, np.ones((*values.shape[:-1], 1))], axis=-1)


@dataclass
class Clone:
    """Implements `interfaces.Policy`."""

    features: tuple[Feature, ...]
    weights: Double  # [F, 2]
    uses_state: bool = False

    def reset(self, step: Step, copies: Int) -> None:
        """It has no memory."""

    def act(self, step: Step) -> Float:
        actions = inputs(self.features, step.observations) @ self.weights
        return actions.clip(-1, 1).astype(np.float32)

    def log_probs(self, step: Step, actions: Float) -> Float:
        return np.zeros(actions.shape[:2], np.float32)


@pytest.fixture(scope="module")
def episodes() -> list[Episode]:
    spec = preset("coop_nav")
    seeds = np.arange(100, dtype=np.uint64)
    return list(rollout(make_env(spec, 50), make_policy("straight", spec), seeds))


def success(episodes: list[Episode], observation: str, communication: str) -> float:
    """Success of a clone of the episodes that senses and hears so, in 64 validation episodes."""
    spec = with_models(preset("coop_nav"), observation, communication)
    task, lengths = make_task(spec), np.array([len(episode) for episode in episodes])
    recorded = RecordedEpisodes(
        states=np.concatenate([episode.states for episode in episodes]),
        actions=np.concatenate([episode.actions for episode in episodes]),
        starts=np.cumsum(lengths) - lengths,
        lengths=lengths,
        seeds=np.array([episode.seed for episode in episodes], dtype=np.uint64),
        layouts=np.stack([episode.layout for episode in episodes]),
    )
    observed = observe_episodes(task, recorded, progress=False)["observations"]
    ends = np.cumsum(lengths + 1) - 1  # states without an action
    features = features_of(task)
    rows = inputs(features, np.delete(observed, ends, axis=0))
    rows = rows.reshape(-1, rows.shape[-1])
    square = rows.T @ rows + 1e-3 * np.eye(rows.shape[1])
    commands = recorded.actions.reshape(-1, 2).astype(np.float64)
    weights: Double = np.linalg.solve(square, rows.T @ commands).astype(np.float64)
    result = evaluate(
        Clone(features, weights), spec, name="linear", n_episodes=64, block="validation",
        progress=False,
    )  # fmt: skip
    return float(np.mean(result.metrics["success"]))


def test_a_goal_that_others_know_is_reached_by_those_who_hear_and_keep_it(
    episodes: list[Episode],
) -> None:
    seen = success(episodes, SEEN, "none")
    heard = success(episodes, HIDDEN, "errand")
    assert seen > 0.2
    assert heard > seen - 0.1
    assert success(episodes, HIDDEN, "none") < 0.05
    assert success(episodes, HIDDEN, "errand+lossy-60") > heard - 0.1
    assert success(episodes, HIDDEN, "errand+lossy-60+expires-0") < 0.05
    assert success(episodes, HIDDEN, "errand+range-1.5") < heard - 0.1


def test_a_goal_that_is_shown_once_is_not_reached_without_a_memory(episodes: list[Episode]) -> None:
    assert success(episodes, f"{SEEN}+goal-for-10", "none") < 0.05
