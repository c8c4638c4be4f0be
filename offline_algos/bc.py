"""Behavior cloning: every agent imitates the joint actions of the dataset.

Pomerleau, "ALVINN", NeurIPS 1988; the deterministic form with a squared error is the imitation term
of TD3+BC (Fujimoto & Gu 2021, eq. 3).

    min_pi  E_{(o, a) ~ D}  1/N sum_i |pi(o_i, i) - a_i|^2

Recorded choices are imitated by a categorical policy, which acts by its likeliest choice:

    min_pi  E_{(o, a) ~ D}  -1/N sum_i log pi(a_i | o_i)

With `memory` gru, pi sees all observations of the episode so far: `learn.memory`.

Deviations: one network for all agents, which sees the agent's number, or with `policy_network`
`deep_sets` one over sets of neighbors and obstacles, which does not; observations are normalized
with the statistics of the dataset; the learning rate decays along a cosine. Recorded action masks
hold when acting (`swarmdata.evaluate_parallel`); batches do not have them, so that pi learns by
itself to leave out what was forbidden.
"""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.interfaces import Policy
from swarmdata.learn.choices.choice_actor import ChoiceActor
from swarmdata.learn.memory.memory_settings import MemorySettings
from swarmdata.learn.memory.recurrent_actor import RecurrentActor, make_actor
from swarmdata.learn.networks.actor import PolicyNetwork, StackedActor
from swarmdata.learn.networks.compilation import compilable
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.presence import agent_mean
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import cloning_loss
from swarmdata.learn.policies.trained import policy_of
from swarmdata.learn.training.actor_critic import OfflineLearner
from swarmdata.learn.training.settings import LogUniform, Space
from swarmdata.types import Batch


@dataclass(frozen=True)
class CloningConfig:
    """Settings of algorithms that imitate; one setting for all datasets."""

    n_updates: int = 18_000
    batch_size: int = 128  # joint transitions, each with the actions of N agents
    hidden: tuple[int, ...] = (64, 64)
    learning_rate: float = 3e-3
    final_learning_rate_factor: float = 0.0  # at the end of the cosine; 1 keeps the rate
    max_grad_norm: float | None = None

    @property
    def discount(self) -> float:
        """1: nothing is bootstrapped."""
        return 1.0


CLONING_SPACE: Space = {"learning_rate": LogUniform(3e-4, 1e-2)}


@dataclass(frozen=True)
class BCConfig(MemorySettings, CloningConfig):
    """Behavior cloning: a squared error of continuous actions, the likelihood of choices."""

    policy_network: PolicyNetwork = "mlp"  # `deep_sets` acts in teams of any size
    output: Literal["tanh", "clip"] = "tanh"  # of continuous actions


class BC(OfflineLearner):
    """K actors, one per seed, trained at once."""

    Config = BCConfig
    FIELDS = ("observations", "actions")
    LOSSES = ("bc_loss",)
    SPACE: ClassVar[Space] = CLONING_SPACE

    def __init__(self, setup: Setup, config: BCConfig) -> None:
        self.config = config
        self.actor = _make_actor(setup, config)
        self.descent = Descent(
            {"actor": self.actor.network}, setup.n_seeds, config.learning_rate,
            config.max_grad_norm, moments={"actor": "optimizer"},
        )  # fmt: skip
        self.parts = (self.descent,)

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...], windows with a memory; returns `bc_loss`, [K]."""
        losses = self._gradient(batch)
        self.descent.descend(self.scale)
        self.n_updates += 1
        return losses

    @compilable
    def _gradient(self, batch: Batch) -> dict[str, Tensor]:
        steps, pi = self.actor.along(batch)  # [K, B, N, A], or of choices log pi [K, B, N, D, C]
        bc_loss: Tensor  # [K]
        if isinstance(self.actor, ChoiceActor):
            bc_loss = agent_mean(self.actor.surprise(pi, steps.actions), steps.alive)
        else:
            bc_loss = cloning_loss(pi, steps.actions, steps.alive)
        self.actor.network.backward(bc_loss.sum())
        return {"bc_loss": bc_loss.detach()}

    def policy(self, index: int) -> Policy:
        return policy_of(self.actor, index)


def _make_actor(setup: Setup, config: BCConfig) -> StackedActor | RecurrentActor | ChoiceActor:
    if not setup.sizes.choices:
        return make_actor(
            setup, config.hidden, config,
            squash=config.output == "tanh", policy_network=config.policy_network,
        )  # fmt: skip
    if config.output != "tanh":
        raise SchemaError(
            f"got output {config.output} for recorded choices: it has an effect on continuous "
            "actions only. Leave it out"
        )
    return ChoiceActor(setup, config.hidden, config, policy_network=config.policy_network)
