"""Small PettingZoo environments that do what real ones do: each tests something of a recorder."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Space, Tuple
from pettingzoo import ParallelEnv

from swarmdata.datasets.dataset import Dataset
from swarmdata.record import Recorder
from swarmdata.specs.origins import RecordedSpec
from swarmdata.types import Float, Int, Step


class Counting(ParallelEnv):  # type: ignore[misc]
    """Observations name the seed, the time and the agent; one buffer is used for all of them.

    Args:
        length: steps of an episode.
        terminates: whether it ends by itself; otherwise it is cut.
        has_state: whether it has `state()`.
        success: what infos say as an agent ends, of each by name or of all; None if nothing.
        leaves: step after which each agent leaves, by name.
        enters: step after which an agent appears, by name.
    """

    def __init__(
        self,
        length: int = 4,
        *,
        terminates: bool = False,
        has_state: bool = True,
        success: bool | dict[str, bool] | None = None,
        leaves: dict[str, int] | None = None,
        enters: dict[str, int] | None = None,
    ) -> None:
        self.metadata = {"name": "counting_v1"}
        self.possible_agents = ["big", "small"]
        self.agents: list[str] = []
        self.length, self.terminates, self.has_state = length, terminates, has_state
        self.success = success
        self.leaves, self.enters = leaves or {}, enters or {}
        self.buffers = {"big": np.zeros(3, np.float32), "small": np.zeros(2, np.float32)}
        self.given: list[dict[str, Any]] = []

    def observation_space(self, agent: str) -> Space[Any]:
        return Box(-np.inf, np.inf, (3 if agent == "big" else 2,), np.float32)

    def action_space(self, agent: str) -> Space[Any]:
        low = np.array([-2.0, 0.0] if agent == "big" else [1.0], np.float32)
        return Box(low, low + 4, dtype=np.float32)

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
        self.seed, self.time = int(seed or 0), 0
        self.agents = [a for a in self.possible_agents if self.enters.get(a, 0) == 0]
        return self._observe(self.agents), {a: {} for a in self.agents}

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        acted, self.time = list(self.agents), self.time + 1
        rewards = {a: float(self.time) for a in acted}
        for action in actions.values():
            action.fill(100)  # an environment may do this
        over = self.time == self.length
        ended = {a: (over and self.terminates) or self.leaves.get(a) == self.time for a in acted}
        cut = dict.fromkeys(acted, over and not self.terminates)
        self.agents = [a for a in acted if not (ended[a] or cut[a])]
        self.agents += [a for a, t in self.enters.items() if t == self.time and not over]
        told = (
            self.success if isinstance(self.success, dict) else dict.fromkeys(acted, self.success)
        )
        infos: dict[str, dict[str, Any]] = {
            a: {"success": told[a]} if told.get(a) is not None and (ended[a] or cut[a]) else {}
            for a in acted
        }
        return self._observe(sorted({*acted, *self.agents})), rewards, ended, cut, infos

    def state(self) -> Any:
        if not self.has_state:
            raise NotImplementedError
        return np.array([self.seed % 1000, self.time], np.float64)

    def _observe(self, agents: list[str]) -> dict[str, Any]:
        for index, buffer in enumerate(self.buffers.values()):
            buffer[:2] = self.seed % 1000, self.time * 10 + index
        return {a: self.buffers[a] for a in agents}


class Together(ParallelEnv):  # type: ignore[misc]
    """A team that acts from a reset on, and ends at once after `length` steps.

    Others say what it is called, its spaces, and what it observes, gets and is told.
    """

    NAME: ClassVar[str]
    ACTIONS: ClassVar[dict[str, Space[Any]]]
    length, terminates = 5, False

    def __init__(self) -> None:
        self.metadata = {"name": self.NAME}
        self.possible_agents, self.agents = list(self.ACTIONS), list[str]()

    def action_space(self, agent: str) -> Space[Any]:
        return self.ACTIONS[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
        self.seed, self.time, self.agents = int(seed or 0), 0, list(self.possible_agents)
        return self.observe(), self.infos()

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        names, self.time = self.agents, self.time + 1
        over, rewards = self.time == self.length, self.rewards(actions)
        self.agents = [] if over else names
        ended, cut = dict.fromkeys(names, over), dict.fromkeys(names, False)
        flags = (ended, cut) if self.terminates else (cut, ended)
        return self.observe(), rewards, *flags, self.infos()

    def observe(self) -> dict[str, Any]:
        raise NotImplementedError

    def rewards(self, actions: dict[str, Any]) -> dict[str, float]:
        return dict.fromkeys(actions, 1.0)

    def infos(self) -> dict[str, Any]:
        return {name: {} for name in self.possible_agents}


class Choosing(Together):
    """One agent for each kind of space; masks come as the caller wants.

    Args:
        mask_in: `info` or `observation`, PettingZoo's two conventions, or None.
    """

    NAME, length, terminates = "Choosing v2", 3, True
    ACTIONS: ClassVar[dict[str, Space[Any]]] = {
        "one": Discrete(3, start=0),
        "many": MultiDiscrete([2, 3]),
        "bits": MultiBinary(2),
        "mixed": Dict({"speed": Box(0.0, 2.0, (1,), np.float32), "gear": Discrete(4, start=1)}),
        "pair": Tuple((Box(-1.0, 1.0, (2,), np.float32), Discrete(2))),
    }

    def __init__(self, mask_in: str | None = None) -> None:
        super().__init__()
        self.mask_in = mask_in
        inner = Dict({"near": Box(0, 255, (2, 2), np.uint8), "phase": Discrete(5)})
        self.spaces: dict[str, Space[Any]] = dict.fromkeys(self.ACTIONS, inner)
        if mask_in == "observation":
            self.spaces["one"] = Dict({"observation": inner, "action_mask": MultiBinary(3)})

    def observation_space(self, agent: str) -> Space[Any]:
        return self.spaces[agent]

    @property
    def mask(self) -> Any:
        return np.array([self.time % 2 == 0, True, True], np.int8)

    def infos(self) -> dict[str, Any]:
        masks = {"one": {"action_mask": self.mask}} if self.mask_in == "info" else {}
        return super().infos() | masks

    def observe(self) -> dict[str, Any]:
        seen = {"near": np.full((2, 2), self.time, np.uint8), "phase": self.time}
        observations: dict[str, Any] = {name: dict(seen) for name in self.possible_agents}
        if self.mask_in == "observation":
            observations["one"] = {"observation": dict(seen), "action_mask": self.mask}
        return observations


class Reaching(Together):
    """Each agent observes the action that is rewarded most, in bounds that are not -1 and 1."""

    NAME = "reaching_v0"
    ACTIONS: ClassVar[dict[str, Space[Any]]] = {
        "slow": Box(-0.5, 0.5, (2,), np.float32),
        "forward": Box(0.0, 4.0, (2,), np.float32),
    }

    def observation_space(self, agent: str) -> Space[Any]:
        return Box(-5, 5, (2,), np.float32)

    def observe(self) -> dict[str, Any]:
        """Returns each agent's best action."""
        source = np.random.default_rng((self.seed, self.time))
        boxes = ((name, self.action_space(name)) for name in self.possible_agents)
        self.best = {name: source.uniform(each.low, each.high) for name, each in boxes}
        return {name: best.astype(np.float32) for name, best in self.best.items()}

    def rewards(self, actions: dict[str, Any]) -> dict[str, float]:
        return {name: -float(np.abs(a - self.best[name]).sum()) for name, a in actions.items()}


class Constant:
    """A policy of two agents that do always the same; remembers what it saw."""

    uses_state = False

    def __init__(self, *rows: list[float]) -> None:
        self.rows, self.seen = np.array([rows], np.float32), list[Step]()

    def reset(self, step: Step, copies: Int) -> None:
        self.seen.append(step)

    def act(self, step: Step) -> Float:
        self.seen.append(step)
        return self.rows

    def log_probs(self, step: Step, actions: Float) -> Float:
        return np.zeros((1, 2), np.float32)


def spec_of(dataset: Dataset) -> RecordedSpec:
    assert isinstance(dataset.spec, RecordedSpec)
    return dataset.spec


def play(env: Any, n_episodes: int, act: Callable[[str, int], Any] | None = None) -> None:
    """Plays episodes with actions of the spaces, or of `act(agent, time)`."""
    for _ in range(n_episodes):
        env.reset()
        time = 0
        while env.agents:
            agents = list(env.agents)
            if act is None:
                actions = {agent: env.action_space(agent).sample() for agent in agents}
            else:
                actions = {agent: act(agent, time) for agent in agents}
            env.step(actions)
            time += 1


def record(
    env: Any,
    path: Path,
    n_episodes: int = 12,
    act: Callable[[str, int], Any] | None = None,
    **options: Any,
) -> Dataset:
    """What a recorder makes of so many episodes, named after the environment."""
    name = options.get("task") or env.metadata.get("name", "").lower().replace(" ", "_")
    with Recorder(env, **{"id": f"{name}-mine-v0", "path": path, **options}) as recorder:
        for index, agent in enumerate(recorder.possible_agents):
            recorder.action_space(agent).seed(index)
        play(recorder, n_episodes, act)
    return recorder.close()


def steady(agent: str, time: int) -> Any:
    """An action of `Counting` that says its time."""
    return np.array([time % 3, 1] if agent == "big" else [1 + time % 4], np.float32)


class Seeing(Together):
    """Two agents that observe images of bytes: seed, time and agent in their pixels.

    Args:
        state: dtype of `state()`, an image, too; None: it has none.
        wrong: what a pixel is at the end, against the space.
    """

    NAME, terminates = "seeing_v0", True
    ACTIONS: ClassVar[dict[str, Space[Any]]] = {
        agent: Box(-1.0, 1.0, (2,), np.float32) for agent in ("left", "right")
    }

    def __init__(self, state: Any = None, wrong: float | None = None) -> None:
        super().__init__()
        self.wrong = wrong
        self.seen = None if state is None else np.zeros((2, 2), state)

    def observation_space(self, agent: str) -> Space[Any]:
        return Box(0, 255, (4, 3, 3) if agent == "left" else (2, 3, 3), np.uint8)

    def rewards(self, actions: dict[str, Any]) -> dict[str, float]:
        return {agent: float(action[0]) for agent, action in actions.items()}

    def state(self) -> Any:
        if self.seen is None:
            raise NotImplementedError
        self.seen[:] = 40 * self.time  # in one buffer
        return self.seen

    def observe(self) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for index, agent in enumerate(self.possible_agents):
            shape = self.observation_space(agent).shape
            found[agent] = np.full(shape, self.seed % 200, np.uint8)
            found[agent][0, 0] = 50 * self.time, index, 255
            if self.wrong is not None and self.time == 5:
                found[agent] = np.full(shape, self.wrong)
        return found
