"""The second stage of training: the policy is extracted again, and a density holds it to the data.

An actor that climbs a critic while the critic learns decides what the critic values, and TD3+BC
holds it to the data by an error that is the same everywhere. So actor-critics can train in two
stages. In the first, critics learn the value of an actor that their own rule moves; a behavior
density learns beside them. In the second, the last `extraction_share` of the updates, the density
stands still, and the actor, which starts where it was, descends one of the losses of
`extraction.objectives`. Critics go on learning, the value of the new actor, so that there are
several steps of policy improvement; with `frozen_critics` there is one
(`cards/studies/validation` and `budgets` have rows with each).

Nobody in good data hits an obstacle, so critics of such data know that the goal is near and not
that contacts cost. Their slopes are short on average and long in some places, and there an actor
that follows them leaves the data. That is why a robot is pulled by at most `slope_limit` slopes:
without a limit, 18,000 updates on `coop_nav-expert` end with one collision an episode
(`cards/studies/budgets`, rows `steep`).

The inverse temperature eta is `inverse_temperature` / slope. The slope is the deviation of Q_i
under the density divided by that of the actions, both as means over robots and rows of the first
batch of the stage. So actions move by about `inverse_temperature` times their variance in the data:
one setting serves rewards of every scale, and data that are all alike are left less than diverse
ones.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.extraction.objectives import anchored_loss, tilted_loss, weighted_loss
from swarmdata.learn.networks.actor import DelayedActor
from swarmdata.learn.networks.behavior_density import BehaviorDensity
from swarmdata.learn.networks.optimizer import StackedAdam
from swarmdata.learn.training.checkpoint import part
from swarmdata.learn.training.exploration import normal_like
from swarmdata.types import Batch

Extraction = Literal["joint", "anchored", "weighted", "tilted"]
"""`joint`: the actor of the first stage is the policy; the others are losses of a second stage."""


EXTRACTION_LOSSES = ("density_loss", "extraction_loss", "extracted_q")
"""Names of the losses that a second stage adds."""


@dataclass(frozen=True)
class ExtractionConfig:
    """Settings of the extraction of a policy; one setting for all datasets.

    Raises:
        SchemaError: a number is outside its range.
    """

    extraction: Extraction = "joint"
    extraction_share: float = 0.4  # of `n_updates`, the last ones; of no meaning for `joint`
    frozen_critics: bool = False  # whether critics stand still in the second stage
    inverse_temperature: float = 2.0  # in units of 1 / slope of Q
    slope_limit: float = 1.5  # of `anchored`: of a robot's pull by Q, in units of the slope of Q
    density_floor: float = 0.1  # least deviation of the density
    extraction_candidates: int = 16  # M of `tilted`, and draws for V_i of `weighted`
    max_extraction_weight: float = 20.0  # of `weighted`; Wang et al. 2020, section 4

    def __post_init__(self) -> None:
        """Checks the numbers."""
        names = ("inverse_temperature", "slope_limit", "density_floor", "max_extraction_weight")
        for name in names:
            if getattr(self, name) <= 0:
                raise SchemaError(f"{name} is {getattr(self, name)}, expected a number above 0")
        if not 0 < self.extraction_share < 1 or self.extraction_candidates < 2:
            raise SchemaError(
                f"extraction_share is {self.extraction_share} and extraction_candidates "
                f"{self.extraction_candidates}, expected above 0 and below 1, and at least 2"
            )


class Valuer(Protocol):
    """The critics' values of one batch's actions; their parameters are constants."""

    def of_policy(self, pi: Tensor) -> Tensor:
        """Returns values [K, B, N] of the policies' actions [K, B, N, A].

        The gradient of their sum with respect to robot i's action is what climbs the critics.
        """
        ...

    def of_candidates(self, candidates: Tensor) -> Tensor:
        """Returns the values [K, B, N, M] of each robot's M actions [K, B, N, M, A].

        The others act as in the data. The gradient is not used.
        """
        ...


class SecondStage:
    """Density, optimizer and temperature of the second stage of K seeds.

    Attributes:
        begins_at: number of updates before the stage.
        has_frozen_critics: whether critics stand still in it.
        density: of the data's actions.

    Args:
        actor: what is extracted into.
        seeds: of the runs, [K].
        generators: of the draws from the density, one per seed, [K].
        config: settings of the extraction.
        n_updates: of both stages.
        learning_rate: of Adam, of the density and of the second stage.
        max_norm: largest norm of one seed's gradient; None does not clip.
    """

    def __init__(
        self,
        actor: DelayedActor,
        seeds: Sequence[int],
        generators: Sequence[torch.Generator],
        config: ExtractionConfig,
        n_updates: int,
        *,
        learning_rate: float,
        max_norm: float | None,
    ) -> None:
        self._actor, self._generators, self._config = actor, generators, config
        self.begins_at = n_updates - round(n_updates * config.extraction_share)
        self.has_frozen_critics = config.frozen_critics
        self.density = BehaviorDensity(
            actor.online, seeds,
            floor=config.density_floor, learning_rate=learning_rate, max_norm=max_norm,
        )  # fmt: skip
        network = actor.online.network
        self._adam = StackedAdam(network, len(seeds), learning_rate, max_norm)
        self._slope = torch.zeros(len(seeds), device=network.flat.device)  # of Q; 0: unknown

    def learn_density(self, batch: Batch, scale: float) -> Tensor:
        """Moves the density to the data; returns its negative log-likelihood, [K].

        Args:
            batch: tensors [K, B, ...].
            scale: factor on the learning rate.
        """
        loss = self.density.gradient(batch.observations, batch.actions)
        self.density.optimizer.descend(scale)
        return loss

    def update(self, batch: Batch, valuer: Valuer, scale: float) -> dict[str, Tensor]:
        """Moves the actor; returns losses, each [K].

        Args:
            batch: tensors [K, B, ...].
            valuer: of this batch.
            scale: factor on the learning rate.
        """
        moments = self.density.moments(batch.observations, batch.actions)
        if not self._slope.all():
            self._slope = self._measure_slope(moments, valuer)
        pi = self._actor(batch.observations)  # [K, B, N, A]
        loss, values = self._loss(pi, batch.actions, moments, valuer)
        self._adam.step(loss, scale)
        return {"extraction_loss": loss.detach(), "extracted_q": values.mean((1, 2)).detach()}

    def _loss(
        self, pi: Tensor, actions: Tensor, moments: tuple[Tensor, Tensor], valuer: Valuer
    ) -> tuple[Tensor, Tensor]:
        """Returns the loss, [K], and the values that it is made of, [K, B, N]."""
        config, eta = self._config, self._config.inverse_temperature / self._slope
        if config.extraction == "anchored":
            values = valuer.of_policy(pi)
            steepest = config.slope_limit * self._slope
            return anchored_loss(pi, values, *moments, eta, steepest), values
        candidates = self._draw(moments)
        with torch.no_grad():
            drawn = valuer.of_candidates(candidates)  # [K, B, N, M]
            taken = valuer.of_candidates(actions[..., None, :])[..., 0]  # [K, B, N]
        if config.extraction == "tilted":
            return tilted_loss(pi, candidates, drawn, eta), drawn.mean(3)
        advantages = taken - drawn.mean(3)
        largest = config.max_extraction_weight
        return weighted_loss(pi, actions, advantages, eta, largest), taken

    def _draw(self, moments: tuple[Tensor, Tensor]) -> Tensor:
        """Returns actions drawn from the density, [K, B, N, M, A]."""
        mean, deviation = (moment[..., None, :] for moment in moments)
        shape = (-1, -1, -1, self._config.extraction_candidates, -1)
        noise = normal_like(self._generators, mean.expand(shape))
        return (mean + deviation * noise).clamp(-1, 1)

    @torch.no_grad()
    def _measure_slope(self, moments: tuple[Tensor, Tensor], valuer: Valuer) -> Tensor:
        """Returns the deviation of Q_i per deviation of actions under the density, [K]."""
        values = valuer.of_candidates(self._draw(moments))
        slope: Tensor = values.std(3).mean((1, 2)) / moments[1].mean((1, 2, 3))
        return slope.clamp(min=1e-6)

    def state_dict(self) -> dict[str, Tensor]:
        """Density, Adam's moments and the slope of values, as copies."""
        adam = {f"extraction_adam.{k}": v for k, v in self._adam.state_dict().items()}
        return {"extraction_slope": self._slope.clone(), **adam, **self.density.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned; other entries are left alone."""
        self._slope = state["extraction_slope"].to(self._slope.device, copy=True)
        self._adam.load_state_dict(part(state, "extraction_adam"))
        self.density.load_state_dict(state)
