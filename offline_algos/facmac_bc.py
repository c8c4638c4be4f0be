"""FACMAC+BC: a factored critic improves actors that stay close to the dataset's actions.

FACMAC (Peng et al. 2021) with the imitation term and the weight lambda of TD3+BC (Fujimoto & Gu
2021, eq. 3-5). With x = (state, all observations), mixers g and team reward r, the agents' mean:

    Q_j(o, a) = g_j(Q_1j(o_1, a_1), ..., Q_Nj(o_N, a_N); x)                          FACMAC eq. 4
    y         = r + gamma (1 - termination) min_j Q'_j(o', pi'(o') + clip(noise, -c, c))
    L(Q_j)    = (Q_j(o, a) - y)^2                 every update                       FACMAC eq. 5
    L(pi)     = -lambda Q_1(o, pi(o)) + 1/N sum_i 1/A |pi(o_i, i) - a_i|^2
                                                  every `policy_delay`-th            FACMAC eq. 7
    lambda    = alpha / max(mean |Q_1(o, pi(o))|, 1), detached

Every agent's action in L(pi) comes from its policy: the centralized policy gradient.

Deviations from FACMAC:
- Two critics, each with a mixer of its own, target policy smoothing and delayed actors, as in TD3
  (Fujimoto et al. 2018); FACMAC has one critic.
- Agents share one utility network and one actor, which see the agent's number, and nothing is
  recurrent.
- `mixer` "free" is FACMAC's nonmonotonic factorization, "monotonic" that of QMIX, with which the
  paper's main results were made, and the default here. "mean" is that of VDN, the paper's
  FACMAC-vdn. Learned mixers see x: the state alone says nothing of obstacles. All average where the
  paper's add up, so that values keep their scale in teams of any size.
- Those of `maddpg_bc`, for the reasons given there: the floor of mean |Q_1|, the means over robots
  and components (`rl_weight` 0.6 does with four robots what the paper's 2.5 does with a sum),
  LayerNorm, normalization, `clip_target`, warm-up, cosines, and the discount.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from swarmdata.learn.networks.factored_critics import FactoredCritics
from swarmdata.learn.networks.mixers import MIXER_NEEDS, MixerKind, chosen_mixer
from swarmdata.learn.networks.network_inputs import Normalizer, RobotRewards
from swarmdata.learn.networks.presence import acting, going_on
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import Loss, td_error, td_target, team_reward, value_size
from swarmdata.learn.policies.torch_policy import SetPolicy, TorchPolicy
from swarmdata.learn.policies.trained import actor_policy
from swarmdata.learn.training.actor_critic import (
    ACTOR_CRITIC_SPACE,
    EXTRACTION_LOSSES,
    TRANSITION,
    LossActorCritic,
    TwoStageConfig,
    Valuer,
)
from swarmdata.learn.training.settings import Choice, LogUniform, Space
from swarmdata.types import Batch


@dataclass(frozen=True)
class FACMACBCConfig(TwoStageConfig):
    """FACMAC with an imitation term; one setting for all datasets."""

    NEEDS: ClassVar[Mapping[str, Any]] = MIXER_NEEDS

    rl_weight: float = 0.6  # alpha, see the deviations above
    mixer: MixerKind = "monotonic"  # see the deviations above
    mixer_embedding: int = 32  # Rashid et al. 2018, appendix C
    mixer_hidden: int = 64  # of the network that makes the mixers' weights, Peng et al. 2021
    clip_target: bool = True


class FACMACBC(LossActorCritic):
    """K seeds of actors and two factored critics, trained at once."""

    Config = FACMACBCConfig
    FIELDS = TRANSITION
    LOSSES = ("critic_loss", "q", "bc_loss", "policy_q", "lambda", *EXTRACTION_LOSSES)
    SPACE: ClassVar[Space] = {
        **ACTOR_CRITIC_SPACE,
        "rl_weight": LogUniform(0.1, 10.0),
        "mixer": Choice(("monotonic", "free")),
    }

    critics: FactoredCritics

    def __init__(self, setup: Setup, config: FACMACBCConfig) -> None:
        mixer = chosen_mixer(setup, config.mixer, config.mixer_embedding, config.mixer_hidden)
        critics = FactoredCritics(
            setup, config.critic_hidden, mixer,
            learning_rate=config.critic_learning_rate, max_norm=config.max_grad_norm,
        )  # fmt: skip
        super().__init__(setup, config, critics)
        self.normalizer = Normalizer(setup.statistics, setup.device)
        self.rewards = RobotRewards(setup.statistics, "team", clip_target=config.clip_target)

    def critic_inputs(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Returns normalized states, [K, B, S], and observations, [K, B, N, O]."""
        return self.normalizer(batch.states, batch.observations)

    def critic_loss(self, batch: Batch, x: tuple[Tensor, Tensor]) -> Loss:
        """Returns sum_j L(Q_j), FACMAC eq. 5; draws the targets' noise."""
        y = self.targets(batch)  # without a gradient
        q = self.critics.q(*x, batch.actions)  # [K, 2, B]
        loss = td_error(q, y)  # [K]
        return Loss(loss, {"critic_loss": loss, "q": q.mean((1, 2))})

    def valuer(self, batch: Batch, x: tuple[Tensor, Tensor]) -> Valuer:
        """Returns the smaller team values of the batch's actions, for a second stage.

        Robot i's value of a candidate is the team's if robot i alone leaves the data. Of the
        policies' actions, each robot gets an equal share of the team's value.
        """
        critics = self.critics

        def of_policy(pi: Tensor) -> Tensor:
            shares = critics.smallest_q(*x, pi) / pi.shape[2]  # [K, B]
            return shares[..., None].expand(pi.shape[:3])

        return Valuer(of_policy, lambda each: critics.candidate_q(*x, each, batch.actions))

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards; draws the smoothing noise."""
        a_next = self.smoothed_actions(batch)
        o_next = acting(batch.next_observations, going_on(batch))
        x_next = self.normalizer(batch.next_states, o_next)
        q_next = self.critics.target_q(*x_next, a_next).amin(1)  # [K, B], the smaller one
        q_next = q_next.clamp(max=self.rewards.max_value)
        r = team_reward(batch.rewards) * self.rewards.scale
        return td_target(r, batch.terminations, q_next, self.config.discount)

    def actor_loss(
        self, batch: Batch, x: tuple[Tensor, Tensor], pi: Tensor, bc_loss: Tensor
    ) -> Loss:
        """Returns L(pi), FACMAC eq. 7; the critics' parameters are constants here."""
        q = self.critics.policy_values(*x, pi)  # [K, B]
        lam = self.config.rl_weight / value_size(q)  # [K]
        return Loss(-lam * q.mean(1) + bc_loss, {"policy_q": q.mean(1), "lambda": lam})

    def policy(self, index: int) -> TorchPolicy | SetPolicy:
        return actor_policy(self.actor.online, index)
