"""What offline algorithms share beside losses: the state, and the two-stage loop of actor-critics.

Actor-critics can train in two stages. In the first, critics learn the value of an actor that their
own rule moves; a behavior density learns beside them. In the second, the last `extraction_share` of
the updates, the density stands still, and the actor descends one of the extraction losses of
`objectives.losses`, pulled by at most `slope_limit` slopes. Critics go on learning, the value of
the new actor; with `frozen_critics` they do not.

The inverse temperature eta is `inverse_temperature` / slope. The slope is the deviation of Q_i
under the density divided by that of the actions, both as means over robots and rows of the first
batch of the stage. So one setting serves rewards of every scale.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple, Protocol

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.networks.actor import (
    BehaviorDensity,
    DelayedActor,
    PolicyNetwork,
    StackedActor,
)
from swarmdata.learn.networks.critics import (
    Critic,
    JointGradient,
    RobotCritics,
    RobotView,
    others_of,
)
from swarmdata.learn.networks.factored_critics import VALUE_STREAM
from swarmdata.learn.networks.network_inputs import (
    Normalizer,
    generator_states,
    normal_like,
    restore_generators,
)
from swarmdata.learn.networks.optimizer import Descent, StackedAdam, cosine
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.presence import acting, agent_mean, going_on
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import Loss, anchored_loss, cloning_loss, tilted_loss
from swarmdata.learn.objectives.weighted_rows import ScoredRows
from swarmdata.learn.training.settings import Choice, LogUniform, Space
from swarmdata.types import Batch

Extraction = Literal["joint", "anchored", "weighted", "tilted"]
"""`joint`: the actor of the first stage is the policy; the others are losses of a second stage."""

SECOND_STAGES = ("anchored", "weighted", "tilted")

EXTRACTION_LOSSES = ("density_loss", "extraction_loss", "extracted_q")
"""Names of the losses that a second stage adds."""

TRANSITION: tuple[str, ...] = (
    "observations", "actions", "rewards", "next_observations", "states", "next_states",
    "terminations",
)  # fmt: skip
"""The fields of a batch that critics learn from."""


@dataclass(frozen=True)
class ActorCriticConfig:
    """Settings that all actor-critics have; one setting for all datasets."""

    n_updates: int = 18_000
    batch_size: int = 128  # joint transitions
    actor_hidden: tuple[int, ...] = (64, 64)
    policy_network: PolicyNetwork = "mlp"  # `deep_sets` acts in teams of any size
    critic_hidden: tuple[int, ...] = (64, 64)  # of everything that estimates values
    actor_learning_rate: float = 3e-3  # see `bc`
    critic_learning_rate: float = 3e-3  # see `maddpg_bc`
    final_learning_rate_factor: float = 0.0  # at the end of the cosine; 1 keeps the rates
    discount: float = 0.95  # see `maddpg_bc`
    tau: float = 0.03  # per update of the targets
    max_grad_norm: float | None = 10.0  # per seed, of each kind of network


ACTOR_CRITIC_SPACE: Space = {
    "actor_learning_rate": LogUniform(3e-4, 1e-2),
    "critic_learning_rate": LogUniform(3e-4, 1e-2),
    "discount": Choice((0.9, 0.95, 0.98, 0.99)),
    "tau": LogUniform(3e-3, 0.1),
}
"""What all actor-critics draw; the algorithms add what they are named after."""


@dataclass(frozen=True)
class ExtractionConfig:
    """Settings of the extraction of a policy; one setting for all datasets."""

    NEEDS: ClassVar[Mapping[str, Any]] = {
        **dict.fromkeys(
            (
                "extraction_share", "frozen_critics", "inverse_temperature", "density_floor",
                "extraction_candidates",
            ),
            ("extraction", SECOND_STAGES),
        ),
        "slope_limit": ("extraction", ("anchored",)),
        "effective_share": ("extraction", ("weighted",)),
    }  # fmt: skip

    extraction: Extraction = "joint"
    extraction_share: float = 0.4  # of `n_updates`, the last ones; of no meaning for `joint`
    frozen_critics: bool = False  # whether critics stand still in the second stage
    inverse_temperature: float = 2.0  # in units of 1 / slope of Q
    slope_limit: float = 1.5  # of `anchored`: of a robot's pull by Q, in units of the slope of Q
    density_floor: float = 0.1  # least deviation of the density
    extraction_candidates: int = 16  # M of `tilted`; draws for V_i of `weighted`, and for slopes
    effective_share: float = 0.3  # of `weighted`: of the rows, see `objectives.weighted_rows`

    def __post_init__(self) -> None:
        if self.inverse_temperature == 0:  # elsewhere, it means that actors only copy
            raise SchemaError("inverse_temperature is 0, expected a number above 0")


@dataclass(frozen=True)
class TwoStageConfig(ActorCriticConfig, ExtractionConfig):
    """The settings of TD3 (Fujimoto et al. 2018), of the warm-up, and of the second stage."""

    RETIRED: ClassVar = ("max_extraction_weight", "bc_warmup_updates")

    policy_delay: int = 2  # Fujimoto & Gu 2021, table 3; the next two too
    smoothing: float = 0.2  # deviation of the noise on the targets' actions
    smoothing_clip: float = 0.5
    bc_warmup_share: float = 0.5  # of `n_updates`, the first ones, in which actors clone the data


class Part(Protocol):
    """Something with parameters, and what their optimizers remember."""

    def state_dict(self) -> dict[str, Any]: ...
    def load_state_dict(self, state: Mapping[str, Any]) -> None: ...


class OfflineLearner(ABC):
    """K seeds of an offline algorithm: their updates so far, and their state."""

    config: Any  # settings, with `n_updates` and `final_learning_rate_factor`
    generators: Sequence[torch.Generator] = ()
    """Of the noise of training, one per seed; empty if there is none."""
    parts: Sequence[Part]
    """All that has parameters; entries of their states have different names."""
    n_updates = 0
    first_stage = 0  # updates before a second stage; 0: there is one stage

    @property
    def scale(self) -> float:
        """The factor on learning rates now: a cosine over the updates of each stage."""
        config, first = self.config, self.first_stage
        begin, end = (0, first) if self.n_updates < first else (first, config.n_updates)
        return cosine(self.n_updates - begin, end - begin, config.final_learning_rate_factor)

    def state_dict(self) -> dict[str, Any]:
        """Parameters, targets, Adam's moments, generators and number of updates, as copies."""
        state: dict[str, Any] = {"n_updates": torch.tensor(self.n_updates)}
        if self.generators:
            state["generators"] = generator_states(self.generators)
        for part in self.parts:
            state |= part.state_dict()
        return state

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self.n_updates = int(state["n_updates"])
        if self.generators and "generators" in state:  # runs that drew nothing only act now
            restore_generators(self.generators, state["generators"])
        for part in self.parts:
            part.load_state_dict(state)


class Valuer(NamedTuple):
    """The critics' values of one batch's actions; their parameters are constants."""

    of_policy: Callable[[Tensor], Tensor]
    """Values [K, B, N] of the policies' actions [K, B, N, A]. The gradient of their sum with
    respect to robot i's action is what climbs the critics."""
    of_candidates: Callable[[Tensor], Tensor]
    """Values [K, B, N, M] of each robot's M actions [K, B, N, M, A] while the others act as in the
    data. The gradient is not used."""


def robot_critics(
    setup: Setup, config: ActorCriticConfig, critic: Critic, name: str = "critics"
) -> RobotCritics:
    """Makes two critics of each seed with a value for each robot; `name`: in checkpoints."""
    return RobotCritics(
        setup.sizes, Normalizer(setup.statistics, setup.device), critic, setup.seeds,
        config.critic_hidden, learning_rate=config.critic_learning_rate,
        max_norm=config.max_grad_norm, device=setup.device, name=name,
    )  # fmt: skip


def value_network(setup: Setup, n_features: int, hidden: tuple[int, ...]) -> StackedMLP:
    """Makes the value networks of K seeds, which have LayerNorm and one output."""
    shape = MLPShape(n_features, hidden, 1, layer_norm=True)
    network = StackedMLP(shape, setup.n_seeds, setup.device)
    initialize(network, setup.seeds, VALUE_STREAM)
    return network


def robot_valuer(
    critics: RobotCritics, x: RobotView, batch: Batch, joint_gradient: JointGradient
) -> Valuer:
    """Returns the smallest of J values of each robot; of one that has left, 0 of the policies'."""
    actions = batch.actions

    def of_policy(pi: Tensor) -> Tensor:
        values = critics.smallest_q(x, pi, others_of(joint_gradient, pi, actions))
        return acting(values[..., None], batch.alive)[..., 0]

    return Valuer(of_policy, lambda candidates: critics.candidate_q(x, candidates, actions))


class TwoStageActorCritic(OfflineLearner):
    """Critics, and actors that move less often; the losses are in the files of the algorithms."""

    critics: Descent

    def __init__(self, setup: Setup, config: TwoStageConfig, critics: Descent) -> None:
        self.config, self.critics = config, critics
        self.actor = DelayedActor(
            squashed_actor(setup, config), setup.n_seeds,
            learning_rate=config.actor_learning_rate, max_norm=config.max_grad_norm,
        )  # fmt: skip
        self.generators = setup.generators()
        self.second_stage, self.parts = None, (self.actor, critics)
        if config.extraction != "joint":
            self.first_stage = config.n_updates - round(config.n_updates * config.extraction_share)
            self.second_stage = SecondStage(self.actor, setup, self.generators, config)
            self.parts = (*self.parts, self.second_stage)

    @abstractmethod
    def critic_inputs(self, batch: Batch) -> Any:
        """Returns what the critics see of a batch besides actions; passed to both losses."""

    @abstractmethod
    def critic_step(self, batch: Batch, x: Any, scale: float) -> dict[str, Tensor]:
        """Moves the critics, at `scale` times the learning rate; returns losses, each [K].

        The batch, [K, B, ...], is seen by the critics as x.
        """

    @abstractmethod
    def actor_step(self, batch: Batch, x: Any, scale: float, is_warmup: bool) -> dict[str, Tensor]:
        """Moves the actors, which clone the data in the warm-up; as `critic_step`."""

    @abstractmethod
    def valuer(self, batch: Batch, x: Any) -> Valuer:
        """Returns the critics' values of a batch's actions, for a second stage."""

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...]; returns losses [K], the actor's only when it moves.

        Actors and targets move in every update of the warm-up and of the second stage, and between
        these in every `policy_delay`-th (Fujimoto et al. 2018, algorithm 1).
        """
        config, stage, scale = self.config, self.second_stage, self.scale
        is_second = stage is not None and self.n_updates >= self.first_stage
        x = self.critic_inputs(batch)
        losses: dict[str, Tensor] = {}
        if not (is_second and config.frozen_critics):
            losses = self.critic_step(batch, x, scale)
        self.n_updates += 1
        is_warmup = self.n_updates <= round(config.n_updates * config.bc_warmup_share)
        if stage is not None and is_second:
            losses |= stage.update(batch, self.valuer(batch, x), scale)
            follows = not config.frozen_critics
        else:
            follows = is_warmup or self.n_updates % config.policy_delay == 0
            if follows:
                losses |= self.actor_step(batch, x, scale, is_warmup)
            if follows and stage is not None:
                losses["density_loss"] = stage.learn_density(batch, scale)
        if follows:
            self.actor.follow(config.tau)
            self.critics.follow(config.tau)
        return {name: loss.detach() for name, loss in losses.items()}

    def smoothed_actions(self, batch: Batch) -> Tensor:
        """Returns pi'(o') + clip(noise, -c, c), [K, B, N, A], in [-1, 1]; draws the noise."""
        config, size = self.config, self.actor.target.shape.outputs
        observations = batch.next_observations
        template = observations[..., :1].expand(*observations.shape[:-1], size)
        noise = normal_like(self.generators, template)
        found = self.actor.smoothed(noise, observations, config.smoothing, config.smoothing_clip)
        return acting(found, going_on(batch))


class LossActorCritic(TwoStageActorCritic):
    """Actor-critics that step down two losses."""

    @abstractmethod
    def critic_loss(self, batch: Batch, x: Any) -> Loss:
        """Returns the critics' loss; draws noise."""

    @abstractmethod
    def actor_loss(self, batch: Batch, x: Any, pi: Tensor, bc_loss: Tensor) -> Loss:
        """Returns the actors' loss after the warm-up, in which it is `bc_loss` alone."""

    def critic_step(self, batch: Batch, x: Any, scale: float) -> dict[str, Tensor]:
        total, reported = self.critic_loss(batch, x)
        self.critics.step(total, scale)
        return reported

    def actor_step(self, batch: Batch, x: Any, scale: float, is_warmup: bool) -> dict[str, Tensor]:
        pi = acting(self.actor(batch.observations), batch.alive)  # [K, B, N, A]
        total = bc_loss = cloning_loss(pi, batch.actions, batch.alive)
        reported: dict[str, Tensor] = {}
        if not is_warmup:
            total, reported = self.actor_loss(batch, x, pi, bc_loss)
        self.actor.step(total, scale)
        return {"bc_loss": bc_loss, **reported}


def squashed_actor(setup: Setup, config: ActorCriticConfig) -> StackedActor:
    """Makes the actors of K seeds, whose outputs pass through tanh."""
    return StackedActor(
        setup, config.actor_hidden, squash=True, policy_network=config.policy_network
    )


class SecondStage:
    """Density, optimizer and temperature of the second stage of K seeds."""

    def __init__(
        self,
        actor: DelayedActor,
        setup: Setup,
        generators: Sequence[torch.Generator],
        config: TwoStageConfig,
    ) -> None:
        self._actor, self._generators, self._config = actor, generators, config
        rate, max_norm = config.actor_learning_rate, config.max_grad_norm
        # of the data's actions
        self.density = BehaviorDensity(
            actor.online, setup.seeds,
            floor=config.density_floor, learning_rate=rate, max_norm=max_norm,
        )  # fmt: skip
        network = actor.online.network
        self._adam = StackedAdam(network, setup.n_seeds, rate, max_norm)
        self._slope = torch.zeros(setup.n_seeds, device=network.flat.device)  # of Q; 0: unknown
        self._rows = ScoredRows(config.effective_share, generators)  # of `weighted`

    def learn_density(self, batch: Batch, scale: float) -> Tensor:
        """Moves the density to the data; returns its negative log-likelihood, [K]."""
        loss = self.density.gradient(batch.observations, batch.actions, batch.alive)
        self.density.descend(scale)
        return loss

    def update(self, batch: Batch, valuer: Valuer, scale: float) -> dict[str, Tensor]:
        """Moves the actor; returns losses, each [K]."""
        moments = self.density.moments(batch.observations, batch.actions)
        if not self._slope.all():
            self._slope = self._measure_slope(moments, valuer, batch.alive)
        loss, values = self._loss(batch, moments, valuer)
        self._adam.step(loss, scale)
        worth = agent_mean(values, batch.alive)
        return {"extraction_loss": loss.detach(), "extracted_q": worth.detach()}

    def _loss(
        self, batch: Batch, moments: tuple[Tensor, Tensor], valuer: Valuer
    ) -> tuple[Tensor, Tensor]:
        """Returns the loss, [K], and the values that it is made of, [K, B, N]."""
        config, eta = self._config, self._config.inverse_temperature / self._slope
        if config.extraction == "anchored":
            pi = acting(self._actor(batch.observations), batch.alive)  # [K, B, N, A]
            values = valuer.of_policy(pi)
            steepest = config.slope_limit * self._slope
            return anchored_loss(pi, values, *moments, eta, steepest), values
        candidates = self._draw(moments)
        with torch.no_grad():
            drawn = valuer.of_candidates(candidates)  # [K, B, N, M]
            taken = valuer.of_candidates(batch.actions[..., None, :])[..., 0]  # [K, B, N]
        if config.extraction == "tilted":
            pi = acting(self._actor(batch.observations), batch.alive)
            return tilted_loss(pi, candidates, drawn, eta), drawn.mean(3)
        self._rows.add(batch, taken - drawn.mean(3), batch.alive)
        actions, pi, _ = self._rows.draw(self._actor.online.along, eta)
        return (pi - actions).square().sum(3).mean((1, 2)), taken

    def _draw(self, moments: tuple[Tensor, Tensor]) -> Tensor:
        """Returns actions drawn from the density, [K, B, N, M, A]."""
        mean, deviation = (moment[..., None, :] for moment in moments)
        shape = (-1, -1, -1, self._config.extraction_candidates, -1)
        noise = normal_like(self._generators, mean.expand(shape))
        return (mean + deviation * noise).clamp(-1, 1)

    @torch.no_grad()
    def _measure_slope(
        self, moments: tuple[Tensor, Tensor], valuer: Valuer, alive: Tensor | None
    ) -> Tensor:
        """Returns the deviation of Q_i per deviation of actions under the density, [K]."""
        values = valuer.of_candidates(self._draw(moments))
        slope = agent_mean(values.std(3), alive) / agent_mean(moments[1], alive)
        return slope.clamp(min=1e-6)

    def state_dict(self) -> dict[str, Tensor]:
        adam = self._adam.state_dict("extraction_adam.")
        parts = {**self.density.state_dict(), **self._rows.state_dict()}
        return {"extraction_slope": self._slope.clone(), **adam, **parts}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._slope = state["extraction_slope"].to(self._slope.device, copy=True)
        self._adam.load_state_dict(state, "extraction_adam.")
        self.density.load_state_dict(state)
        self._rows.load_state_dict(state)
