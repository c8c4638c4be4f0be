"""Actors do not learn from rows of agents that have left, and values end where an agent does."""

from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv

import swarmdata
from swarmdata.learn.training.run_files import read_table
from swarmdata.learn.training.run_folder import load_last
from swarmdata.registry.components import OFFLINE_ALGORITHMS
from tests.support.pairs import slow

GOOD, N_STEPS, N_LEFT = 0.8, 20, 3  # what both agents do; `second` leaves after 3 steps
SMALL = {"n_updates": 300, "batch_size": 64}
BY_VALUE_ALONE = {"matd3"}  # imitates nobody
NEEDS_EVENTS = {"iql_cost"}


class Leaving(ParallelEnv):  # type: ignore[misc]
    """Two agents whose observations hardly say whether they are there."""

    metadata: ClassVar = {"name": "leaving_v0"}
    render_mode = None

    def __init__(self, space: Box | Discrete) -> None:
        self.possible_agents = ["first", "second"]
        self.space, self.taken = space, {name: list[float]() for name in self.possible_agents}

    def observation_space(self, agent: str) -> Box:
        return Box(-1, 1, (2,), np.float32)

    def action_space(self, agent: str) -> Box | Discrete:
        return self.space

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.rng, self.time, self.agents = np.random.default_rng(seed), 0, [*self.possible_agents]
        return self.see(), {name: {} for name in self.agents}

    def see(self) -> dict[str, Any]:
        return {name: np.array([0, self.rng.random() < 0.1], np.float32) for name in self.agents}

    def judge(self, name: str) -> tuple[float, bool, bool]:
        """An agent's reward in this step, whether it ends there, and whether it is cut."""
        has_left = name == "second" and self.time == N_LEFT
        return -abs(self.taken[name][-1] - GOOD), has_left, self.time == N_STEPS and not has_left

    def step(self, actions: dict[str, Any]) -> Any:
        self.time += 1
        for name, action in actions.items():
            self.taken[name].append(float(np.ravel(action)[0]))
        judged = {name: self.judge(name) for name in actions}
        rewards, ends, cuts = ({n: each[k] for n, each in judged.items()} for k in range(3))
        seen = self.see()
        self.agents = [name for name in self.agents if not (ends[name] or cuts[name])]
        return seen, rewards, ends, cuts, {name: {} for name in seen}


class Tempting(Leaving):
    """Whoever begins below 0 leaves at once with a reward of 2; others get 1 in each of 10 steps.

    What an agent sees where it leaves looks like what others see later.
    """

    def see(self) -> dict[str, Any]:
        return {name: np.array([self.time == 0, 0], np.float32) for name in self.agents}

    def judge(self, name: str) -> tuple[float, bool, bool]:
        has_left = name == "second" and self.time == 1 and self.taken[name][-1] < 0
        return 2.0 if has_left else 1.0, has_left, self.time == 10


class Interrupted(Leaving):
    """Whoever begins below 0 gets 1.5 a step instead of 1; there, half of the steps cut `second`.

    A cut is no end: what an agent sees where it is cut is worth what others get there.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.place = dict.fromkeys(self.possible_agents, 0.0)
        return super().reset(seed)

    @cached_property
    def begun(self) -> dict[str, list[float]]:
        """The first actions, which alone matter."""
        return {name: [] for name in self.possible_agents}

    def see(self) -> dict[str, Any]:
        return {
            name: np.array([self.place[name], self.time == 0], np.float32) for name in self.agents
        }

    def judge(self, name: str) -> tuple[float, bool, bool]:
        if self.time == 1:
            self.begun[name].append(self.taken[name][-1])
            self.place[name] = 1.0 if self.taken[name][-1] >= 0 else -1.0
        is_good = self.place[name] > 0
        is_cut = name == "second" and not is_good and self.rng.random() < 0.5
        return 1.0 if is_good else 1.5, False, is_cut or self.time == 10


class Endless(Leaving):
    """About 1 a step, until a time limit of 10 steps; `second` leaves one episode in 20."""

    n_episodes = 0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.n_episodes += 1
        return super().reset(self.n_episodes)

    def step(self, actions: dict[str, Any]) -> Any:
        self.time += 1
        rewards = {name: self.rng.normal(1.0, 0.3) for name in actions}
        leaves = self.n_episodes % 20 == 0 and self.time == N_LEFT
        ends = {name: name == "second" and leaves for name in actions}
        cuts = dict.fromkeys(actions, self.time == 10)
        seen = self.see()
        self.agents = [name for name in self.agents if not (ends[name] or cuts[name])]
        return seen, rewards, ends, cuts, {name: {} for name in seen}


def recorded(
    folder: Path, space: Box | Discrete, kind: type[Leaving] = Leaving, spread: float = 0.05
) -> swarmdata.Dataset:
    rng, mean = np.random.default_rng(0), GOOD if kind is Leaving else 0.0
    with swarmdata.Recorder(kind(space), id="leaving_v0-mine-v0", path=folder) as recorder:
        for _ in range(40 if kind is Leaving else 60):
            recorder.reset()
            while recorder.agents:
                if isinstance(space, Discrete):
                    recorder.step(dict.fromkeys(recorder.agents, 2))
                    continue
                drawn = {name: rng.normal(mean, spread, 1) for name in recorder.agents}
                recorder.step({k: v.clip(-1, 1).astype(np.float32) for k, v in drawn.items()})
    return recorder.close()


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> swarmdata.Dataset:
    return recorded(tmp_path_factory.mktemp("leaving") / "data", Box(-1, 1, (1,), np.float32))


def played(
    algorithm: str, data: swarmdata.Dataset, folder: Path, env: Leaving, **changes: Any
) -> float:
    """Mean action of the agent that leaves, by the policy that an algorithm learns."""
    (policy,) = swarmdata.train(
        algorithm, data.path, folder, n_seeds=1, changes=SMALL | changes, progress=False
    )
    seeds = swarmdata.foreign_evaluation_seeds(8)
    spec: Any = data.spec
    swarmdata.evaluate_parallel(policy, lambda: env, spec, seeds)
    return float(np.mean(env.taken["second"]))


FAST = ("bc", "iql", "maddpg_bc", "vdn", "bc_flow")
ALL = sorted(set(OFFLINE_ALGORITHMS) - BY_VALUE_ALONE - NEEDS_EVENTS)


@pytest.mark.parametrize("algorithm", [*FAST, *slow(*(each for each in ALL if each not in FAST))])
def test_agents_that_leave_do_not_learn_to_rest(
    algorithm: str, data: swarmdata.Dataset, tmp_path: Path
) -> None:
    env = Leaving(Box(-1, 1, (1,), np.float32))
    assert played(algorithm, data, tmp_path / "run", env) == pytest.approx(GOOD, abs=0.25)


@pytest.mark.parametrize(
    ("algorithm", "changes"),
    [
        ("bc", {}),
        ("vdn", {"regulariser": "bcq"}),
        pytest.param("iql", {}, marks=pytest.mark.slow),
        pytest.param("vdn", {"regulariser": "cql"}, marks=pytest.mark.slow),
        pytest.param("qmix", {"regulariser": "bc"}, marks=pytest.mark.slow),
    ],
)
def test_neither_do_those_that_choose(
    algorithm: str, changes: dict[str, Any], tmp_path: Path
) -> None:
    data = recorded(tmp_path / "data", Discrete(3))
    env = Leaving(Discrete(3))
    assert played(algorithm, data, tmp_path / "run", env, **changes) == pytest.approx(2, abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(
    "algorithm",
    ["iql", "maddpg_bc", "matd3", "cfcql", "omar", "omiga", "oryx", "mac_flow", "facmac_bc", "vdn"],
)
def test_a_value_ends_with_the_agent(algorithm: str, tmp_path: Path) -> None:
    data = recorded(tmp_path / "data", Box(-1, 1, (1,), np.float32), Tempting, spread=0.6)
    env = Tempting(Box(-1, 1, (1,), np.float32))
    weak = {"cql_weight": 0.1} if algorithm == "cfcql" else {}
    played(algorithm, data, tmp_path / "run", env, n_updates=600, **weak)
    assert len(env.taken["second"]) == 8 * 10, "it stays"


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["iql", "maddpg_bc", "omar", "oryx", "mac_flow"])
def test_a_value_does_not_end_where_an_agent_is_cut(algorithm: str, tmp_path: Path) -> None:
    data = recorded(tmp_path / "data", Box(-1, 1, (1,), np.float32), Interrupted, spread=0.6)
    env = Interrupted(Box(-1, 1, (1,), np.float32))
    changes: dict[str, dict[str, Any]] = {
        "maddpg_bc": {"extraction": "weighted"},
        "oryx": {"value_learning_rate": 0.01, "tau": 0.1},
    }
    settings = {"n_updates": 900, **changes.get(algorithm, {})}
    played(algorithm, data, tmp_path / "run", env, **settings)
    assert np.mean(env.begun["second"]) < 0


@pytest.mark.parametrize("algorithm", ["vdn", *slow("qmix", "omiga", "facmac_bc")])
def test_a_time_limit_is_no_end_of_a_team_that_can_be_left(algorithm: str, tmp_path: Path) -> None:
    data = recorded(tmp_path / "data", Box(-1, 1, (1,), np.float32), Endless, spread=0.6)
    changes: dict[str, Any] = {} if algorithm == "omiga" else {"clip_target": False}
    changes |= {"n_updates": 800, "discount": 0.8}
    swarmdata.train(
        algorithm, data.path, tmp_path / "run", n_seeds=1, changes=SMALL | changes, progress=False
    )
    rows = read_table(tmp_path / "run" / "losses.csv")
    values = [row["q"] for row in rows if "q" in row][-1]
    values *= load_last(tmp_path / "run").statistics.return_std
    assert values == pytest.approx(1 / (1 - 0.8), rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["bc", "iql", "vdn"])
def test_neither_do_those_that_remember(
    algorithm: str, data: swarmdata.Dataset, tmp_path: Path
) -> None:
    env = Leaving(Box(-1, 1, (1,), np.float32))
    found = played(algorithm, data, tmp_path / "run", env, memory="gru")
    assert found == pytest.approx(GOOD, abs=0.25)
