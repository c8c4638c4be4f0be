"""OG-MARL's MADDPG+CQL (instadeepai/og-marl, torch), from a checkout; f4eb8f0 is what was measured.

Theirs: the recurrent policy and the critics of 128 units (their constructor does not let one choose
these), losses, rates, windows of 20 steps that cross the ends of episodes. Ours: windows instead of
their Flashbax buffer, as many of them as hold the batch's transitions; the number of updates; the
units of the policy; and the state, which has all observations beside it, as our critics see it.
Packages for other backends, buffers, data and logs are absent.
"""

import copy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from swarmdata import Policy, Step
from swarmdata.errors import SchemaError
from swarmdata.rollouts.action_probabilities import LastMeans, certain_log_probs
from swarmdata.types import Batch, Float, Int
from tests.benchmarks.peers.checkouts import import_from
from tests.benchmarks.peers.team_data import Budget, TeamData

MODULE = "og_marl.baselines.torch_systems.offline.maddpg_cql"
ABSENT = (
    "chex", "flashbax", "hydra", "jax", "omegaconf", "tree", "wandb", "og_marl.environments",
    "og_marl.loggers", "og_marl.replay_buffers", "og_marl.vault_utils",
    "og_marl.vault_utils.download_vault", "og_marl.wrapped_environments",
    "og_marl.wrapped_environments.base",
)  # fmt: skip
WINDOW = 20
"""Steps, `sequence_length` of its configs."""


def maddpg_cql(checkout: Path, data: TeamData, budget: Budget, seed: int) -> Policy:
    """Trains its system with the defaults of its constructor."""
    torch.manual_seed(seed)
    module, rng = import_from(checkout, MODULE, *ABSENT), np.random.default_rng(seed)
    world = SimpleNamespace(
        agents=[f"agent_{i}" for i in range(data.n_agents)],
        num_actions=data.n_actions,
        observation_shape=(data.n_observations,),
        state_shape=(data.n_states + data.n_agents * data.n_observations,),
    )
    units = {"linear_layer_dim": budget.units, "recurrent_layer_dim": budget.units}
    system = module.MADDPGCQLSystem(world, None, device="cpu", **units)
    n_windows = -(-budget.batch_size // WINDOW)
    for _ in range(budget.n_updates):
        system._train_step(_experience(data.windows(rng, n_windows, WINDOW)))
    return RecurrentPolicy(data, system.policy_network, module.batch_concat_agent_id_to_obs)


def _experience(windows: Batch) -> dict[str, Any]:
    """What its buffer returns: NumPy arrays [B, T, ...]."""
    shape = windows.rewards.shape

    def spread(flags: Tensor) -> Any:
        return flags[..., None].expand(shape).numpy()

    state = torch.cat([windows.states, windows.observations.flatten(2)], -1)
    return {
        "observations": windows.observations.numpy(),
        "actions": windows.actions.numpy(),
        "rewards": windows.rewards.numpy(),
        "terminals": spread(windows.terminations),
        "truncations": spread(windows.truncations),
        "infos": {"state": state.numpy()},
    }


class RecurrentPolicy:
    """Its shared network, with one hidden state for each robot in each copy.

    Args:
        data: that it learned from.
        network: its `DeepRNNPolicy`.
        with_agent_id: its function that adds the robot's number to inputs [E, 1, N, O].
    """

    uses_state = False

    def __init__(self, data: TeamData, network: Any, with_agent_id: Any) -> None:
        self._data, self._with_agent_id = data, with_agent_id
        self._network = copy.deepcopy(network).double().eval()
        self._last = LastMeans()
        self._hidden = torch.zeros(0)  # [E, N, H], made at the first reset

    def reset(self, step: Step, copies: Int) -> None:
        """Forgets what happened in some copies."""
        shape = (*step.observations.shape[:2], self._network.recurrent_layer_dim)
        if self._hidden.shape != shape:
            self._hidden = torch.zeros(shape, dtype=torch.float64)
        self._hidden[torch.from_numpy(copies)] = 0.0

    @torch.no_grad()
    def act(self, step: Step) -> Float:
        """Joint actions [E, N, A]."""
        inputs = self._with_agent_id(self._data.inputs(step.observations)[:, None])[:, 0]
        n_copies, n_agents = inputs.shape[:2]
        actions, hidden = self._network(inputs.flatten(0, 1), self._hidden.flatten(0, 1)[None])
        self._hidden = hidden[0].unflatten(0, (n_copies, n_agents))
        chosen = self._data.in_world(step.observations, actions.unflatten(0, (n_copies, n_agents)))
        self._last.keep(step, chosen)
        return chosen.astype(np.float32)

    def log_probs(self, step: Step, actions: Float) -> Float:
        """Of the step that it acted on last: certainty.

        Raises:
            SchemaError: it is another step.
        """
        chosen = self._last.recall(step)
        if chosen is None:
            raise SchemaError(
                "a policy with a memory was asked about a step it did not act on last"
            )
        return certain_log_probs(chosen.astype(np.float32), actions)
