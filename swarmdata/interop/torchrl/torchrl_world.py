"""TorchRLWorld: the copies of a task as one environment of TorchRL, a batch [E].

Keys are those of our datasets in TorchRL (see `torchrl`): ("agents", "observation") [E, N, O],
("agents", "action") [E, N, A], ("agents", "events") [E, N, 4], ("agents", "reward") [E, N, 1] and
`state` [E, S]. What is collected here and what was recorded can be joined in one replay buffer.
"""

import secrets
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from swarmdata.interfaces import VecEnv
from swarmdata.numerics.random import EVALUATION_BASE, derive
from swarmdata.registry.components import make_env
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import EVENTS, Int, Step

GROUP = "agents"
"""The only group of agents: observations and actions of all robots have the same shape."""


class TorchRLWorld(EnvBase):
    """Copies of a task with TorchRL's API.

    A copy that has ended stays as it is until it is reset, so that its last observation is not
    lost. Episodes have seeds that no evaluation uses. `success` [E, 1] is true in the step in which
    a copy's task is solved.

    Args:
        spec: the task.
        n_copies: copies that are stepped together, E.
        seed: of all episodes; drawn if None. `set_seed` begins another stream.
    """

    def __init__(self, spec: TaskSpec, n_copies: int, seed: int | None = None) -> None:
        super().__init__(device="cpu", batch_size=torch.Size([n_copies]))
        self.task_spec = spec
        self.group_map = {GROUP: list(spec.agent_names)}
        self._env: VecEnv = make_env(spec, n_copies)
        self._stream, self._n_begun = secrets.randbits(62) if seed is None else seed, 0
        self._describe()

    def _describe(self) -> None:
        """Sets the specs of what it takes and gives."""
        env, (E,), N = self._env, self.batch_size, self.task_spec.n_agents
        flag = Categorical(2, dtype=torch.bool, shape=(E, 1))
        self.observation_spec = Composite(
            {
                GROUP: Composite(
                    {
                        "observation": Unbounded((E, N, env.observation_size)),
                        "events": Unbounded((E, N, len(EVENTS)), dtype=torch.uint8),
                    },
                    shape=(E, N),
                ),
                "state": Unbounded((E, env.state_size)),
                "success": flag.clone(),
            },
            shape=(E,),
        )
        action = Bounded(-1.0, 1.0, (E, N, env.action_size), dtype=torch.float32)
        reward = Unbounded((E, N, 1))
        ends = {name: flag.clone() for name in ("done", "terminated", "truncated")}
        self.action_spec = _of_agents("action", action)
        self.reward_spec = _of_agents("reward", reward)
        self.done_spec = Composite(ends, shape=(E,))

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        """Starts episodes in all copies, or in those that the key `_reset` names."""
        copies = np.arange(self._env.n_copies)
        if tensordict is not None and "_reset" in tensordict.keys():  # noqa: SIM118  (no mapping)
            copies = copies[tensordict["_reset"].reshape(-1).numpy()]
        return self._tensors(self._env.reset(self._draw(len(copies)), copies))

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        actions: NDArray[np.float32] = tensordict[GROUP, "action"].detach().numpy()
        step = self._env.step(np.ascontiguousarray(actions))
        tensors = self._tensors(step)
        tensors[GROUP, "reward"] = torch.from_numpy(step.rewards)[..., None]
        return tensors

    def _set_seed(self, seed: int | None) -> None:
        if seed is not None:
            self._stream, self._n_begun = seed, 0

    def _draw(self, n: int) -> NDArray[np.uint64]:
        """Seeds of the next n episodes, far from those that are reserved for evaluation."""
        numbers: Int = self._n_begun + np.arange(n)
        self._n_begun += n
        return derive(self._stream, numbers.astype(np.uint64)) % np.uint64(EVALUATION_BASE)

    def _tensors(self, step: Step) -> TensorDict:
        """What all copies show, except for rewards; a step's arrays are never written again."""
        flags = {
            "terminated": step.terminations,
            "truncated": step.truncations,
            "done": step.ended,
            "success": step.successes,
        }
        shown: dict[tuple[str, ...], NDArray[Any]] = {
            (GROUP, "observation"): step.observations,
            (GROUP, "events"): step.events,
            ("state",): step.states,
            **{(name,): values[:, None] for name, values in flags.items()},
        }
        found = TensorDict({GROUP: TensorDict({}, self._team)}, self.batch_size)
        for key, values in shown.items():
            found[key] = torch.from_numpy(values)
        return found

    @property
    def _team(self) -> torch.Size:
        return torch.Size([*self.batch_size, self.task_spec.n_agents])


def _of_agents(name: str, spec: Any) -> Composite:
    """A spec under the key of the agents."""
    shape = spec.shape
    return Composite({GROUP: Composite({name: spec}, shape=shape[:2])}, shape=shape[:1])
