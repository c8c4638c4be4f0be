"""The worlds that K seeds of an online algorithm learn in: E copies of a task for each seed."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.setup import Sizes
from swarmdata.numerics.random import EVALUATION_BASE, derive
from swarmdata.perception.frames import Frame
from swarmdata.rollouts.side_env import AnyEnv, SideEnv
from swarmdata.store.arrays.column_meanings import state_layout
from swarmdata.types import Double, Float, Int, Seeds, Step


class Worlds:
    """K groups of E copies, stepped together; copies that end are reset at once.

    Copy k E + e of `env` belongs to seed k. A seed's episodes are a function of the seed and of its
    own past, so that they are the same whichever seeds run beside it. Robots observe and act in
    `frame`; None: the world's.
    """

    def __init__(self, env: AnyEnv, seeds: Sequence[int], frame: Frame | None) -> None:
        if not seeds or env.n_copies % len(seeds):
            raise SchemaError(
                f"{env.n_copies} copies for {len(seeds)} seeds, expected the same number for each"
            )
        self.env, self.frame = env, frame
        self.n_seeds, self.n_copies = len(seeds), env.n_copies // len(seeds)
        self._seeds: Seeds = np.asarray(seeds, dtype=np.uint64)
        self._episodes: Int = np.zeros(len(seeds), np.int64)  # begun so far, [K]
        # in which the next actions are taken, of all copies, in the world's frame
        self.current_step = self._begin(np.arange(env.n_copies))

    @property
    def first_robot(self) -> int:
        """The first of the robots that act, among those of the state."""
        return self.env.spec.agents.agents.start if isinstance(self.env, SideEnv) else 0

    @property
    def sizes(self) -> Sizes:
        """Numbers of robots and features, those that the frame adds included."""
        env, n_added = self.env, 0 if self.frame is None else self.frame.n_added
        # of a side, the robots of a state are not those that act
        known = None if isinstance(env, SideEnv) else env.task
        robots, vectors = state_layout(known, env.state_size)
        return Sizes(
            n_agents=env.spec.n_agents,
            observation=env.observation_size + n_added,
            action=env.action_size,
            state=env.state_size,
            frame=self.frame,
            robot_columns=robots,
            state_vectors=vectors,
        )

    def observations(self, step: Step) -> Float:
        """Returns the observations of all copies in the robots' frame, by seed, [K, E, N, O]."""
        return self.grouped(self.local_observations(step))

    def local_observations(self, step: Step) -> Float:
        """Returns the observations of any copies in the robots' frame, [C, N, O]."""
        return step.observations if self.frame is None else self.frame.inputs(step.observations)

    def grouped(self, array: Any) -> Any:
        """Views an array of all copies, [K E, ...], by seed, [K, E, ...]."""
        return array.reshape(self.n_seeds, self.n_copies, *array.shape[1:])

    def to_local(self, step: Step, actions: Float) -> Double:
        """Returns actions of the world's frame, [K E, N, A], in the robots', [K, E, N, A]."""
        if self.frame is None:
            return self.grouped(actions.astype(np.float64))
        return self.grouped(self.frame.to_local(step.observations, actions))

    def to_world(self, step: Step, actions: Float) -> Double:
        """Returns actions of the robots' frame, [K, E, N, A], in the world's, [K E, N, A]."""
        flat = actions.reshape(-1, *actions.shape[2:])
        if self.frame is None:
            return flat.astype(np.float64)
        return self.frame.to_world(step.observations, flat)

    def advance(self, actions: Float) -> Step:
        """Takes actions in the robots' frame, [K, E, N, A]; returns the step before any reset."""
        next_step = self.env.step(self.to_world(self.current_step, actions))
        ended = np.flatnonzero(next_step.ended)
        self.current_step = self._begin(ended) if len(ended) else next_step
        return next_step

    def restart(self) -> None:
        """Begins new episodes everywhere: after checkpoints, so that a resumed run is the same."""
        self.current_step = self._begin(np.arange(self.env.n_copies))

    def state_dict(self) -> dict[str, Tensor]:
        """Episodes begun so far; running episodes are not kept, see `restart`."""
        return {"episodes": torch.from_numpy(self._episodes.copy())}

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        self._episodes = state["episodes"].numpy().copy()
        self.restart()

    def _begin(self, copies: Int) -> Step:
        """Resets copies with fresh training seeds, far from the reserved evaluation seeds."""
        groups = copies // self.n_copies
        counts = np.bincount(groups, minlength=self.n_seeds)
        first = np.cumsum(counts) - counts
        numbers = self._episodes[groups] + np.arange(len(copies)) - first[groups]
        self._episodes += counts
        seeds = derive(self._seeds[groups], numbers) % np.uint64(EVALUATION_BASE)
        return self.env.reset(seeds, copies)


def standard_normal(generators: Sequence[np.random.Generator], shape: tuple[int, ...]) -> Float:
    """Returns standard normal numbers, [K, *shape], those of a seed from its own generator."""
    return np.stack([g.standard_normal(shape, dtype=np.float32) for g in generators])


def pack(content: Any) -> Tensor:
    """Returns what JSON can hold as bytes, uint8, for a checkpoint."""
    return torch.from_numpy(np.frombuffer(json.dumps(content).encode(), np.uint8).copy())


def unpack(packed: Tensor) -> Any:
    """Returns what `pack` was given."""
    return json.loads(packed.numpy().tobytes())
