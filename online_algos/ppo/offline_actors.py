"""MAPPO that begins with the actors of an offline run, whose actions are clipped as its own are.

MAPPO learns from the steps of its present policies only: recorded data cannot be mixed in, and its
critic, of states and observations, begins anew.
"""

from collections.abc import Sequence
from typing import Any, Protocol

from swarmdata.errors import CheckpointError, SpecError
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.online_algos.continuation.offline_start import (
    OfflineStart,
    actor_of,
    as_text,
    checked_actors,
    frame_name,
    hidden_sizes,
)
from swarmdata.online_algos.ppo.initial_weights import StartConfig
from swarmdata.online_algos.ppo.networks import Actors
from swarmdata.specs.features import Feature

WHEN_STARTED = {"std": "0.2", "critic_warmup_fraction": "0.1"}
"""Settings of a training that starts from an offline run, where the user gives no others.

The advantages of an untrained critic would undo the policy, and so would a beginner's noise."""


class HasActors(Protocol):
    """MAPPO, or an algorithm like it."""

    seeds: tuple[int, ...]
    actors: Actors

    @property
    def config(self) -> Any: ...
    def policy(self, index: int) -> TorchPolicy: ...


def settings_of(start: OfflineStart, features: Sequence[Feature]) -> dict[str, str]:
    """Returns the settings of the run's actors, and `WHEN_STARTED`.

    Args:
        start: the run.
        features: of the task's observations.

    Raises:
        CheckpointError: the run's policies are no actors whose actions are clipped, or have other
            hidden layers than two of one width.
    """
    actor = actor_of(start, squash=False)
    hidden = hidden_sizes(actor.layers)
    if len(hidden) != 2 or hidden[0] != hidden[1]:
        raise CheckpointError(
            f"the actors of {start.name} have hidden layers of {as_text(hidden)} units, expected "
            "two of the same width, as mappo has them."
        )
    frame = frame_name(actor.frame, features)
    return {
        "hidden": str(hidden[0]), "parameters": actor.parameters, "frame": frame, **WHEN_STARTED
    }  # fmt: skip


def start_from(self: HasActors, start: OfflineStart) -> list[str]:
    """Takes over actors and the statistics of their inputs.

    Raises:
        CheckpointError: the actors do not fit.
        SpecError: `config.start` names other policies or a teacher.
    """
    if self.config.start != StartConfig():
        raise SpecError(
            f"the settings start.* name other policies or a teacher, but training starts from "
            f"{start.name}; leave one of them out"
        )
    actors = self.actors
    actor_of(start, squash=False)
    for k, actor in enumerate(checked_actors(start, self.seeds, self.policy(0))):
        rows = slice(k * actors.n_rows, (k + 1) * actors.n_rows)
        actors.network.load_layers(rows, actor.layers)
    actors.input_mean, actors.input_std = start.moments(len(self.seeds))[:2]
    return [f"The critic begins anew: {start.run.algorithm} has none of mappo's kind."]
