"""The critic's values of the states of a rollout."""

from collections.abc import Sequence

import numpy as np
import torch

from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.online_algos.ppo.networks import Actors, Critic
from swarmdata.online_algos.ppo.rollout_samples import Rollout, critic_states, pad_by_seed, ranks
from swarmdata.types import Step


def fill_values(
    rollout: Rollout, ends: Sequence[Step], worlds: Worlds, actors: Actors, critic: Critic
) -> None:
    """Writes `values` and `next_values`.

    Args:
        rollout: all else of it is written.
        ends: for each step of the rollout, the last steps of the episodes that ended in it.
        worlds: in the step after the rollout.
        actors: they make the inputs.
        critic: of the same seeds.
    """
    r = rollout
    r.values[:] = critic.values(torch.from_numpy(r.actor_inputs), torch.from_numpy(r.states))
    inputs = actors.inputs(worlds.observations(worlds.current_step))[None]
    states = torch.from_numpy(worlds.grouped(critic_states(worlds.current_step)))[None]
    r.next_values[:] = np.concatenate([r.values[1:], critic.values(inputs, states)])
    t, k, e = np.nonzero(r.ended)
    if len(t):
        last = Step._make(map(np.concatenate, zip(*ends, strict=True)))
        inputs = actors.inputs(pad_by_seed(worlds.local_observations(last), k, worlds.n_seeds))
        states = torch.from_numpy(pad_by_seed(critic_states(last), k, worlds.n_seeds))
        r.next_values[t, k, e] = critic.values(inputs[None], states[None])[0][k, ranks(k)]
