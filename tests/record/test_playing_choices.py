"""From recorded choices to policies that choose, and back into the environment."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, MultiDiscrete, Space

from swarmdata import FunctionPolicy
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import SchemaError
from swarmdata.record import (
    Recorder,
    evaluate_parallel,
    foreign_evaluation_seeds,
    policy_actions,
    step_of,
)
from swarmdata.specs.origins import RecordedSpec
from swarmdata.types import Bool, Float, Step
from tests.record.worlds import Constant, Together, play, record, spec_of

torch = pytest.importorskip("torch")

LENGTH = 5
FILTERED = {"hidden": "32", "fraction": "0.3", "min_episodes": "1"}


class Signals(Together):
    """Each agent sees a number and is paid for naming it; `few` knows fewer numbers, from 1 on.

    Args:
        has_masks: forbids `many` its right answer.
    """

    NAME, length = "signals_v0", LENGTH
    ACTIONS: ClassVar[dict[str, Space[Any]]] = {
        "many": MultiDiscrete([4, 2]),
        "few": Discrete(2, start=1),
    }

    def __init__(self, has_masks: bool = False) -> None:
        super().__init__()
        self.has_masks = has_masks

    def observation_space(self, agent: str) -> Space[Any]:
        return Box(0, 1, (4,), np.float32)

    def rewards(self, actions: dict[str, Any]) -> dict[str, float]:
        for name, action in actions.items():
            assert self.ACTIONS[name].contains(action), (name, action)
        many, few = actions["many"], actions["few"]
        return {
            "many": float(many[0] == self.signal["many"]) + 0.5 * float(many[1] == 1),
            "few": float(few - 1 == self.signal["few"]),
        }

    def observe(self) -> dict[str, Any]:
        rng = np.random.default_rng([self.seed, self.time])
        self.signal = {"many": int(rng.integers(4)), "few": int(rng.integers(2))}
        return {name: np.eye(4, dtype=np.float32)[number] for name, number in self.signal.items()}

    def infos(self) -> dict[str, Any]:
        mask = np.ones(6, np.int8)
        mask[self.signal["many"]] = 0
        return {"many": {"action_mask": mask} if self.has_masks else {}, "few": {}}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return record(Signals(), tmp_path_factory.mktemp("recorded") / "ds", 60)


@pytest.fixture(scope="module")
def spec(dataset: Dataset) -> RecordedSpec:
    return spec_of(dataset)


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "regulariser"), [("vdn", "bcq"), ("qmix", "cql")])
def test_choices_are_learned_and_played(
    dataset: Dataset, spec: RecordedSpec, tmp_path: Path, algorithm: str, regulariser: str
) -> None:
    """Random data; a policy that names every number gets (1.5 + 1) / 2 a step, chance 0.625."""
    from swarmdata.evaluation.runs.train import train
    from swarmdata.learn.training.run_folder import load_run

    changes = {
        "n_updates": "250", "batch_size": "64", "hidden": "32", "regulariser": regulariser,
        "discount": "0.5", "learning_rate": "3e-3",
    }  # fmt: skip
    if regulariser == "bcq":
        changes["threshold"] = "0.1"
    policy = train(
        algorithm, str(dataset.path), tmp_path / "run", n_seeds=1, changes=changes, progress=False
    )[0]
    seeds = foreign_evaluation_seeds(4)
    result = evaluate_parallel(policy, Signals, spec, seeds)
    assert result.metrics["return"].mean() > 0.9 * 1.25 * LENGTH
    again = evaluate_parallel(load_run(tmp_path / "run")[0], Signals, spec, seeds)
    np.testing.assert_array_equal(again.metrics["return"], result.metrics["return"])


@pytest.mark.learns
@pytest.mark.parametrize(
    ("algorithm", "changes", "least", "most"),
    [
        ("bc", {"hidden": "32"}, 0.0, 0.1),  # does what most do
        ("filtered_bc", FILTERED, 0.95, 1.0),
        ("filtered_bc", {**FILTERED, "memory": "gru"}, 0.95, 1.0),
        ("iql", {"actor_hidden": "32", "critic_hidden": "32", "discount": "0.5"}, 0.95, 1.0),
    ],
)
def test_the_better_choices_are_imitated(
    tmp_path: Path, algorithm: str, changes: dict[str, str], least: float, most: float
) -> None:
    """A third of the episodes are right; in the others all numbers are named one too high."""
    from swarmdata.evaluation.runs.train import train

    env = Signals()
    path = tmp_path / "ds"
    with Recorder(env, id="signals_v0-mine-v0", path=path) as recorder:
        for error in (0, 1, 1) * 20:

            def answer(agent: str, time: int, error: int = error) -> Any:
                if agent == "few":
                    return np.int64((env.signal["few"] + error) % 2 + 1)
                return np.array([(env.signal["many"] + error) % 4, 1 - error])

            play(recorder, 1, answer)
    recorder.close()
    settings = {"n_updates": "400", "batch_size": "128", **changes}
    policy = train(
        algorithm, str(path), tmp_path / "run", n_seeds=1, changes=settings, progress=False
    )[0]
    spec = spec_of(Dataset.open(path))
    result = evaluate_parallel(policy, Signals, spec, foreign_evaluation_seeds(4))
    assert least <= result.metrics["return"].mean() / (1.25 * LENGTH) <= most


class Listens(Constant):
    """Takes the first allowed choice instead where it is told."""

    def act_among(self, step: Step, allowed: Bool) -> Float:
        assert allowed.shape == (1, 2, 6)
        assert allowed.sum(-1).tolist() == [[5, 2]]
        rows = self.rows.copy()
        rows[0, 0, 0] = float(np.flatnonzero(allowed[0, 0, :4])[0])
        return rows


def test_masks_of_the_environment_reach_the_policy(spec: RecordedSpec) -> None:
    seeds = foreign_evaluation_seeds(2)
    policy = Listens([0, 1], [1, 0])
    result = evaluate_parallel(policy, lambda: Signals(has_masks=True), spec, seeds)
    few = result.metrics["return"] * 2 - 0.5 * LENGTH  # what is left when `many` is never right
    assert (few <= LENGTH).all()
    with pytest.raises(SchemaError, match="has no act_among"):
        evaluate_parallel(Constant([0, 1], [1, 0]), lambda: Signals(has_masks=True), spec, seeds)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (([0.5, 1], [1, 0]), r"chose 0\.5 in column 0 of the action of many, .* from 0 to 3"),
        (([0, 2], [1, 0]), r"chose 2 in column 1 of the action of many, .* from 0 to 1"),
        (([0, 1], [0, 0]), "chose 0 in column 0 of the action of few, .* from 1 to 2"),
    ],
)
def test_what_is_no_choice_is_refused(spec: RecordedSpec, rows: Any, message: str) -> None:
    with pytest.raises(SchemaError, match=message):
        evaluate_parallel(Constant(*rows), Signals, spec, foreign_evaluation_seeds(1))


def test_a_function_chooses_as_recorded(dataset: Dataset, spec: RecordedSpec) -> None:
    """Clipped to [-1, 1], it would never name the numbers above 1."""

    def act(seen: Float) -> Float:
        named = seen.argmax(-1).astype(float)  # [E, N]
        return np.stack([named + np.array([0, 1]), np.ones_like(named) * [1, 0]], -1)

    seeds = foreign_evaluation_seeds(2)
    result = evaluate_parallel(FunctionPolicy(act, units=dataset.spec), Signals, spec, seeds)
    assert result.metrics["return"].tolist() == [1.25 * LENGTH] * 2
    with pytest.raises(SchemaError, match=r"are choices, .* units=dataset.spec"):
        evaluate_parallel(FunctionPolicy(act, units="unit"), Signals, spec, seeds)


def test_actions_are_those_of_the_environment(spec: RecordedSpec) -> None:
    step = step_of(np.zeros((2, 4), np.float32), np.zeros(8, np.float32), seed=0, time=0)
    actions = policy_actions(Constant([3, 1], [2, 0]), spec, step)
    assert actions["many"].tolist() == [3, 1]
    assert actions["few"] == 2
