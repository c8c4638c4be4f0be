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
  FACMAC-vdn: it mixes nothing. Mixing costs score in `coop_nav`, whose team reward is a mean of the
  robots' own. On `coop_nav-medium-replay`, whose data score 24.4 and whose clone 22.4 (64 units,
  batches of 128, 256 validation episodes): after 3,000 updates "mean" 39.2, 39.9 and 37.1, "free"
  16.1, 24.3 and 20.4, "monotonic" 15.2, 13.6 and 12.3; after 6,000 (1 seed, 192 episodes) "mean"
  52.3, "monotonic" 29.6. A mixer has to learn from x what "mean" supposes, and is slower for it;
  one that begins near the mean was no better (17.3 after 3,000 updates).
  Learned mixers see x: the state alone says nothing of obstacles. All average where the paper's add
  up, so that values keep their scale in teams of any size.

Those of `maddpg_bc`, for the reasons given there:
- mean |Q_1| is taken as at least 1, one standard deviation of the returns-to-go.
- The imitation error is averaged over agents and action components, so that value and data pull
  one robot with the same strength in teams of any size. `rl_weight` 0.6 does with four robots what
  the paper's 2.5 does with a sum.
- Utilities have LayerNorm; inputs are normalized, rewards divided by the standard deviation of the
  returns-to-go.
- `clip_target`: y uses min(Q', R*), with R* the largest discounted return-to-go of the dataset.
- Warm-up: in the first `bc_warmup_updates` lambda is 0 and actors move in every update.
- Learning rates decay along a cosine, from 1e-3 for critics and 3e-3 for actors; the discount is
  0.95.
"""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from swarmdata.learn.extraction.second_stage import EXTRACTION_LOSSES
from swarmdata.learn.extraction.valuers import FactoredValuer
from swarmdata.learn.networks.factored_critics import MIXER_STREAM, FactoredCritics
from swarmdata.learn.networks.mixers import FreeMixer, HyperMixer, MeanMixer, Mixer, MonotonicMixer
from swarmdata.learn.networks.normalizer import Normalizer
from swarmdata.learn.objectives.in_sample import cloning_loss
from swarmdata.learn.objectives.td_targets import td_error, td_target, team_reward
from swarmdata.learn.training.actor_critic import (
    Loss,
    TwoStageConfig,
    delayed_actor,
    delayed_update,
    policy_of,
    restore_state,
    second_stage,
    smoothed_actions,
    state_of,
)
from swarmdata.learn.training.setup import Setup
from swarmdata.types import Batch

MIXERS: dict[str, type[HyperMixer] | None] = {
    "mean": None,  # nothing is learned
    "monotonic": MonotonicMixer,
    "free": FreeMixer,
}


@dataclass(frozen=True)
class FACMACBCConfig(TwoStageConfig):
    """FACMAC with an imitation term; one setting for all datasets."""

    rl_weight: float = 0.6  # alpha, see the deviations above
    mixer: Literal["mean", "monotonic", "free"] = "monotonic"  # see the deviations above
    mixer_embedding: int = 32  # Rashid et al. 2018, appendix C
    mixer_hidden: int = 64  # of the network that makes the mixers' weights, Peng et al. 2021
    clip_target: bool = True


class FACMACBC:
    """K seeds of actors and two factored critics, trained at once."""

    Config = FACMACBCConfig
    LOSSES = ("critic_loss", "q", "bc_loss", "policy_q", "lambda", *EXTRACTION_LOSSES)

    update, policy = delayed_update, policy_of
    state_dict, load_state_dict = state_of, restore_state
    bc_loss = staticmethod(cloning_loss)

    def __init__(self, setup: Setup, config: FACMACBCConfig) -> None:
        self.config, self.n_updates = config, 0
        self.actor = delayed_actor(setup, config)
        sizes, seeds = setup.sizes, setup.seeds
        learned = MIXERS[config.mixer]
        mixer: Mixer = MeanMixer() if learned is None else learned(
            sizes.n_agents, sizes.information, seeds, MIXER_STREAM,
            embedding=config.mixer_embedding, hidden=config.mixer_hidden, device=setup.device,
            n_critics=2,
        )  # fmt: skip
        self.critics = FactoredCritics(
            sizes, seeds, config.critic_hidden, mixer, learning_rate=config.critic_learning_rate,
            max_norm=config.max_grad_norm, device=setup.device,
        )  # fmt: skip
        self.generators = setup.generators()
        self.normalizer = Normalizer(setup.statistics, setup.device, clip_target=config.clip_target)
        self.second_stage = second_stage(setup, config, self.actor, self.generators)

    def critic_inputs(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Returns normalized states, [K, B, S], and observations, [K, B, N, O]."""
        known = self.normalizer
        return known.states(batch.states), known.observations(batch.observations)

    def critic_loss(self, batch: Batch, x: tuple[Tensor, Tensor]) -> Loss:
        """Returns sum_j L(Q_j), FACMAC eq. 5; draws the targets' noise."""
        y = self.targets(batch)  # without a gradient
        q = self.critics.q(*x, batch.actions)  # [K, 2, B]
        loss = td_error(q, y)  # [K]
        return Loss(loss, {"critic_loss": loss, "q": q.mean((1, 2))})

    def valuer(self, batch: Batch, x: tuple[Tensor, Tensor]) -> FactoredValuer:
        """Returns the critics' values of the batch's actions, for a second stage."""
        return FactoredValuer(self.critics, *x, batch.actions)

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards; draws the smoothing noise."""
        known, a_next = self.normalizer, smoothed_actions(self, batch.next_observations)
        s_next = known.states(batch.next_states)
        o_next = known.observations(batch.next_observations)
        q_next = self.critics.target_q(s_next, o_next, a_next).amin(1)  # [K, B], the smaller one
        q_next = q_next.clamp(max=known.max_value)
        r = team_reward(batch.rewards) * known.reward_scale
        return td_target(r, batch.terminations, q_next, self.config.discount)

    def actor_loss(
        self, batch: Batch, x: tuple[Tensor, Tensor], pi: Tensor, bc_loss: Tensor
    ) -> Loss:
        """Returns L(pi), FACMAC eq. 7; the critics' parameters are constants here."""
        q = self.critics.policy_values(*x, pi)  # [K, B]
        lam = self.config.rl_weight / q.detach().abs().mean(1).clamp(min=1.0)  # [K]
        return Loss(-lam * q.mean(1) + bc_loss, {"policy_q": q.mean(1), "lambda": lam})
