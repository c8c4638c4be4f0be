"""FACMAC+BC: a factored critic improves actors that stay close to the dataset's actions.

FACMAC (Peng et al. 2021) with the imitation term and the weight lambda of TD3+BC (Fujimoto & Gu
2021, eq. 3-5). With x = (state, all observations), mixers g and team reward r, the agents' mean:

    Q_j(o, a) = g_j(Q_1j(o_1, a_1), ..., Q_Nj(o_N, a_N); x)                          FACMAC eq. 4
    y         = r + gamma (1 - termination) min_j Q'_j(o', pi'(o') + clip(noise, -c, c))
    L(Q_j)    = (Q_j(o, a) - y)^2                 every update                       FACMAC eq. 5
    L(pi)     = -lambda Q_1(o, pi(o)) + sum_i 1/A |pi(o_i, i) - a_i|^2
                                                  every `policy_delay`-th            FACMAC eq. 7
    lambda    = alpha / max(mean |Q_1(o, pi(o))|, 1), detached

Every agent's action in L(pi) comes from its policy: the centralized policy gradient.

Deviations from FACMAC:
- Twin critics, each with a mixer of its own, target policy smoothing and delayed actors, as in TD3
  (Fujimoto et al. 2018); FACMAC has one critic.
- Agents share one utility network and one actor, which see the agent's number, and nothing is
  recurrent.
- `mixer` "free" is FACMAC's nonmonotonic factorization, "monotonic" that of QMIX, with which the
  paper's main results were made, and "mean" that of VDN, the paper's FACMAC-vdn. B3C (Kim et al.
  2026) found "free" the better one offline in most tasks; on `coop_nav-medium-replay` (2 seeds,
  critics of 64 units, batches of 128, alpha 3, 100 episodes) it scored 17.7 after 8,000 updates and
  "mean" 23.6 after 4,000, so "mean" is the default: the team's reward is a mean of the robots' own.
  Learned mixers see x: the state alone says nothing of obstacles. All average where the paper's add
  up, so that values keep their scale in teams of any size.

Those of `maddpg_bc`, for the reasons given there:
- mean |Q_1| is taken as at least 1, one standard deviation of the returns-to-go.
- The imitation error is summed over agents and averaged over action components.
- Utilities have LayerNorm; inputs are normalized, rewards divided by the standard deviation of the
  returns-to-go.
- `clip_target`: y uses min(Q', R*), with R* the largest discounted return-to-go of the dataset.
- Warm start: during the first `warm_start` updates lambda is 0 and actors move in every update.
- Step sizes decay along a cosine, from 1e-3 for critics and 3e-3 for actors; the discount is 0.95.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor

from swarmdata.learn.networks.actor import DelayedActor
from swarmdata.learn.networks.factored_critics import MIXER_STREAM, FactoredCritics
from swarmdata.learn.networks.mixers import FreeMixer, HyperMixer, MeanMixer, Mixer, MonotonicMixer
from swarmdata.learn.networks.network_inputs import generator_states, generators, restore_generators
from swarmdata.learn.networks.normalizer import Normalizer
from swarmdata.learn.networks.optimizer import cosine
from swarmdata.learn.networks.sizes import Sizes
from swarmdata.learn.objectives.td_targets import td_target, team_reward
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.dataset_statistics import Statistics
from swarmdata.types import Batch

MIXERS: dict[str, type[HyperMixer] | None] = {
    "mean": None,  # nothing is learned
    "monotonic": MonotonicMixer,
    "free": FreeMixer,
}


@dataclass(frozen=True)
class FACMACBCConfig:
    """FACMAC with an imitation term; one setting for all datasets."""

    n_updates: int = 8_000
    batch_size: int = 256  # joint transitions
    actor_hidden: tuple[int, ...] = (128, 128)
    critic_hidden: tuple[int, ...] = (128, 128)
    mixer: Literal["mean", "monotonic", "free"] = "mean"  # see the deviations above
    embedding: int = 32  # of the mixers, Rashid et al. 2018, appendix C
    mixer_hidden: int = 64  # of the network that makes the mixers' weights, Peng et al. 2021
    step_size: float = 3e-3  # see `bc`
    critic_step_size: float = 1e-3  # see `maddpg_bc`
    final_step_size: float = 0.0  # factor at the end of the cosine; 1 keeps the step sizes
    discount: float = 0.95
    polyak: float = 0.01  # per actor update
    policy_delay: int = 2  # Fujimoto & Gu 2021, table 3; the next three too
    noise: float = 0.2
    noise_clip: float = 0.5
    alpha: float = 2.5  # Fujimoto & Gu 2021, table 3
    clip_target: bool = True
    warm_start: int = 4000
    max_gradient_norm: float | None = 10.0  # per seed, of each network kind


class FACMACBC:
    """K seeds of actors and twin factored critics, trained at once.

    Args:
        sizes: numbers of agents and features.
        seeds: of initial parameters and noise, [K].
        config: settings.
        statistics: of the dataset: normalization, reward scale and R*.
        device: where to train.
    """

    Config = FACMACBCConfig
    LOSSES = ("critic_loss", "q", "bc_loss", "policy_q", "lambda")

    def __init__(
        self,
        sizes: Sizes,
        seeds: Sequence[int],
        config: FACMACBCConfig,
        *,
        statistics: Statistics,
        device: torch.device | str = "cpu",
    ) -> None:
        self.config, self.n_updates = config, 0
        norm = config.max_gradient_norm
        self.actor = DelayedActor(
            sizes, seeds, config.actor_hidden, statistics,
            step_size=config.step_size, max_norm=norm, device=device,
        )  # fmt: skip
        learned = MIXERS[config.mixer]
        mixer: Mixer = MeanMixer() if learned is None else learned(
            sizes.n_agents, sizes.state + sizes.n_agents * sizes.observation, seeds, MIXER_STREAM,
            embedding=config.embedding, hidden=config.mixer_hidden, device=device, n_twins=2,
        )  # fmt: skip
        self.critics = FactoredCritics(
            sizes, seeds, config.critic_hidden, mixer,
            step_size=config.critic_step_size, max_norm=norm, device=device,
        )  # fmt: skip
        self.generators = generators(seeds, device)
        self.normalizer = Normalizer(statistics, device)
        self.reward_scale = 1 / statistics.return_std
        self.max_value = statistics.max_return * self.reward_scale  # R*

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...]; returns losses [K], the actor's only when it moves."""
        config = self.config
        scale = cosine(self.n_updates, config.n_updates, config.final_step_size)
        losses = self._update_critics(batch, scale)
        self.n_updates += 1
        is_warm = self.n_updates <= config.warm_start
        if is_warm or self.n_updates % config.policy_delay == 0:
            losses |= self._update_actor(batch, 0.0 if is_warm else config.alpha, scale)
            self.actor.follow(config.polyak)
            self.critics.follow(config.polyak)
        return {name: loss.detach() for name, loss in losses.items()}

    def _update_critics(self, batch: Batch, scale: float) -> dict[str, Tensor]:
        s, o = self._normalized(batch.states, batch.observations)
        y = self.targets(batch)  # [K, B]
        q = self.critics.q(s, o, batch.actions)  # [K, 2, B]
        critic_loss = (q - y[:, None]).square().mean(2).sum(1)  # [K]
        self.critics.step(critic_loss, scale)
        return {"critic_loss": critic_loss, "q": q.mean((1, 2))}

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B], in units of scaled rewards; draws the smoothing noise."""
        config = self.config
        a_next = self.actor.smoothed(
            batch.next_observations, self.generators, config.noise, config.noise_clip
        )
        s_next, o_next = self._normalized(batch.next_states, batch.next_observations)
        q_next = self.critics.target_q(s_next, o_next, a_next).amin(1)  # [K, B]
        if config.clip_target:
            q_next = q_next.clamp(max=self.max_value)
        r = team_reward(batch.rewards) * self.reward_scale
        return td_target(r, batch.terminations, q_next, config.discount)

    def _update_actor(self, batch: Batch, alpha: float, scale: float) -> dict[str, Tensor]:
        pi = self.actor(batch.observations)  # [K, B, N, A]
        bc_loss = (pi - batch.actions).square().sum(2).mean((1, 2))  # [K]
        if alpha == 0:
            self.actor.step(bc_loss, scale)
            return {"bc_loss": bc_loss}
        # the critics' parameters are constants here
        s, o = self._normalized(batch.states, batch.observations)
        q = self.critics.policy_values(s, o, pi)  # [K, B]
        lam = alpha / q.detach().abs().mean(1).clamp(min=1.0)  # [K]
        self.actor.step(-lam * q.mean(1) + bc_loss, scale)
        return {"bc_loss": bc_loss, "policy_q": q.mean(1), "lambda": lam}

    def _normalized(self, states: Tensor, observations: Tensor) -> tuple[Tensor, Tensor]:
        return self.normalizer.states(states), self.normalizer.observations(observations)

    def policy(self, index: int) -> TorchPolicy:
        """The policy of seed number `index`, as it is now."""
        return self.actor.policy(index)

    def state_dict(self) -> dict[str, Any]:
        """Parameters, targets, Adam's moments, generators and number of updates, as copies."""
        return {
            "n_updates": torch.tensor(self.n_updates),
            "generators": generator_states(self.generators),
            **self.actor.state_dict(),
            **self.critics.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        self.n_updates = int(state["n_updates"])
        restore_generators(self.generators, state["generators"])
        self.actor.load_state_dict(state)
        self.critics.load_state_dict(state)
