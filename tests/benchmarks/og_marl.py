"""OG-MARL's own torch systems on our data, from a checkout of its source.

Its `train_step` and its Flashbax buffer run as they are. Modules that it imports for what is not
measured (hydra, wandb, its environments and downloads) are replaced by empty ones.
"""

import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np

from swarmdata.types import Batch

ABSENT = (
    "hydra", "omegaconf", "tree", "wandb", "og_marl.environments", "og_marl.loggers",
    "og_marl.vault_utils", "og_marl.vault_utils.download_vault", "og_marl.wrapped_environments",
    "og_marl.wrapped_environments.base",
)  # fmt: skip
SYSTEMS = {"iddpg_bc": "IDDPGBCSystem", "maddpg_cql": "MADDPGCQLSystem"}
SEQUENCE, BATCH = 20, 32
"""Its configs: windows of 20 steps, 32 of them."""


def og_marl(source: Path, name: str, data: Batch) -> Callable[[], object]:
    """Returns what draws a batch and makes one update with the defaults of its constructor.

    Args:
        source: a checkout of instadeepai/og-marl.
        name: of the system.
        data: consecutive transitions, [T, ...].
    """
    for absent in ABSENT:
        sys.modules.setdefault(absent, MagicMock(spec=ModuleType, __path__=[]))
        for attribute in ("DictConfig", "get_environment", "BaseEnvironment", "BaseLogger",
                          "WandbLogger", "download_and_unzip_vault", "main"):  # fmt: skip
            setattr(sys.modules[absent], attribute, MagicMock())
    if str(source) not in sys.path:
        sys.path.insert(0, str(source))
    n_agents, n_observations = data.observations.shape[1:]
    environment = SimpleNamespace(
        agents=[f"agent_{i}" for i in range(n_agents)],
        num_actions=data.actions.shape[2],
        observation_shape=(n_observations,),
        # `iddpg_bc` adds the number of agents to the states' size and to its critic's inputs
        state_shape=(data.states.shape[1],),
    )
    module = import_module(f"og_marl.baselines.torch_systems.offline.{name}")
    system = getattr(module, SYSTEMS[name])(environment, None, device="cpu")
    sample = _buffer(data)
    return lambda: system.train_step(sample())


def _buffer(data: Batch) -> Callable[[], Any]:
    """Its replay buffer, filled."""
    jax: Any = import_module("jax")
    flashbax: Any = import_module("flashbax.buffers.trajectory_buffer")
    buffers: Any = import_module("og_marl.replay_buffers")
    shape = np.asarray(data.rewards).shape

    def spread(flags: Any) -> Any:
        return np.broadcast_to(np.asarray(flags)[:, None], shape)

    columns = {
        "observations": data.observations,
        "actions": data.actions,
        "rewards": data.rewards,
        "terminals": spread(data.terminations),
        "truncations": spread(data.truncations),
        "infos": {"state": data.states},
    }
    filled = jax.tree.map(lambda values: jax.numpy.asarray(np.asarray(values))[None], columns)
    buffer = buffers.FlashbaxReplayBuffer(sequence_length=SEQUENCE, batch_size=BATCH)
    buffer._buffer_state = flashbax.TrajectoryBufferState(
        experience=filled,
        current_index=jax.numpy.array(len(shape and data.rewards), dtype=int),
        is_full=jax.numpy.array(False),
    )
    sample: Callable[[], Any] = buffer.sample
    return sample
