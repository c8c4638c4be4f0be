"""MAC-Flow: one-step actors that copy a joint flow of the data and climb a factored critic.

Lee, Lee & Zhang, "Multi-agent Coordination via Flow Matching", ICLR 2026, arXiv 2511.05005; the
one-step actor that is distilled from a flow and maximizes values is that of Flow Q-learning (Park,
Li & Levine 2025, arXiv 2502.02538). We could read neither the paper's equations nor its code: what
follows is the method of its abstract and of the documentation of Flow Q-learning. With
c = (state, all observations), a flow and its samples F of `learn.flows.joint_flow`, noise z of the
team of which robot i knows z(i), and its own reward r_i:

    L(F)   = conditional flow matching of the joint action
    y_i    = r_i + gamma (1 - termination) min_j Q'_j(o'_i, mu(o'_i, z'(i)))
    L(Q_j) = mean_i (Q_j(o_i, a_i) - y_i)^2
    L(mu)  = 1/N sum_i 1/A |mu(o_i, z(i)) - T_i|^2 - lambda Q_tot
    Q_tot  = mean_i min_j Q_j(o_i, mu(o_i, z(i)))

With `reward` "team", critics give Q_tot = g(Q_1, ..., Q_N; c) as those of `facmac_bc` do, and y is
made of the team's reward, the mean of the robots'. T is F(c, z) about the mean of the data, see
`learn.flows.one_step_actor`.

Deviations:
- `reward` "own": each robot's critic learns from its own reward, where the paper decomposes a
  team's. A mean spreads each robot's signal over the team.
- `noise` "team": robots know all noise, by a seed that they agreed on. With their own noise alone
  ("own", the paper's decentralized actors) they cannot tell what the others choose.
- lambda is measured, and the slope of Q that pulls a robot is bounded, see below; Flow Q-learning
  offers a division by mean |Q| and takes a weight for each dataset.
- The smaller of two critics, bounded in y by the data's largest return-to-go.
- Robots share one actor and one critic, which see their number. Critics have LayerNorm, inputs are
  normalized, rewards divided by the deviation of the returns-to-go, actors end in tanh.
- Two stages: in the first part `critic_share` of the updates, flow and critics learn and actors
  only copy, so that critics value the copied flow; then both stand still, and actors climb. 0 is
  one stage, all in every update, as in Flow Q-learning.
- Learning rates decay along a cosine in each stage.
- With `memory` gru the actors remember, also in y, where they act one step later. Flow and critics
  see the present alone: what a robot was told once does not move a critic's gradient.

How far actors climb. The copy's squared error is the same everywhere, and the slope of a critic is
not: where a team's actions are all alike, critics were never told what others are worth. So both
scales are measured on a batch, by M samples F(c, z_m) of the flow in each row and their mean m:

    v      = variance of F_i over the samples, mean over rows, robots and components
    s      = mean deviation of Q_i over M draws from N(m_i, v), divided by sqrt(v): the slope of Q
    lambda = 2 eta v / (A s)
    loss   = - lambda mean_i clip(dQ_i / dmu_i, slope_limit s) mu_i

A mean over the data of (a - m)^2 would be v plus the squared error of m, and so climb far where the
flow fits badly. Beside the copy's error this is `anchored_loss` of `learn.objectives.losses`, times
2 v / A: actions leave the flow's by at most eta v times `slope_limit`, whatever the unit of
rewards.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.flows.one_step_actor import Distillation, FlowSettings, StudentView
from swarmdata.learn.networks.factored_critics import FactoredCritics
from swarmdata.learn.networks.mixers import MIXER_NEEDS, MixerKind, chosen_mixer
from swarmdata.learn.networks.network_inputs import (
    Normalizer,
    Reward,
    RobotRewards,
    information,
    normal_like,
)
from swarmdata.learn.networks.presence import acting, agent_mean, going_on
from swarmdata.learn.networks.setup import Setup
from swarmdata.learn.objectives.losses import (
    Loss,
    bounded_gradient,
    cloning_loss,
    td_error,
    td_target,
)
from swarmdata.learn.policies.drawn_policy import FlowPolicy, RecurrentFlowPolicy
from swarmdata.learn.policies.trained import flow_policy
from swarmdata.learn.training.actor_critic import (
    ACTOR_CRITIC_SPACE,
    TRANSITION,
    ActorCriticConfig,
    OfflineLearner,
)
from swarmdata.learn.training.settings import Choice, LogUniform, Space
from swarmdata.types import Batch

N_DRAWS = 4
"""M; the slope is a mean over all robots of a batch, so that few are enough."""


@dataclass(frozen=True)
class MACFlowConfig(FlowSettings, ActorCriticConfig):
    """A joint flow, its students and factored critics; one setting for all datasets."""

    NEEDS: ClassVar[Mapping[str, Any]] = MIXER_NEEDS

    critic_share: float = 0.65  # see the deviations above
    inverse_temperature: float = 2.0  # as `maddpg_bc`; 0 only copies the flow
    slope_limit: float = 1.5  # as `maddpg_bc`
    reward: Reward = "own"
    mixer: MixerKind = "mean"
    mixer_embedding: int = 32  # Rashid et al. 2018, appendix C
    mixer_hidden: int = 64  # of the network that makes the mixers' weights, Peng et al. 2021
    clip_target: bool = True

    def __post_init__(self) -> None:
        if self.policy_network != "mlp":
            raise SchemaError(
                f"policy_network is {self.policy_network!r}, expected 'mlp': one-step actors see "
                "noise beside their observations, and have no networks over sets."
            )
        if not 0 <= self.critic_share < 1:
            raise SchemaError(
                f"critic_share is {self.critic_share}, expected a part of the updates, from 0 (one "
                "stage) to below 1"
            )
        if self.reward == "own" and self.mixer != "mean":
            raise SchemaError(
                f"mixer is {self.mixer!r} with reward 'own', expected reward 'team': mixers learn "
                "how the team's value depends on its robots'."
            )

    @property
    def first_stage(self) -> int:
        """Updates in which flow and critics learn and actors only copy; 0: there is one stage."""
        return round(self.critic_share * self.n_updates)


class Climb:
    """How far actors climb critics: the scales of K seeds, 0 until they are measured."""

    def __init__(
        self,
        n_seeds: int,
        *,
        inverse_temperature: float,
        slope_limit: float,
        device: torch.device | str,
    ) -> None:
        self._eta, self._limit = inverse_temperature, slope_limit
        self.slope = torch.zeros(n_seeds, device=device)  # s
        self.weight = torch.zeros(n_seeds, device=device)  # lambda

    @property
    def is_measured(self) -> bool:
        return bool(self.slope.all())

    @torch.no_grad()
    def measure(
        self, samples: Tensor, noise: Tensor, value_of: Callable[[Tensor], Tensor],
        alive: Tensor | None = None,
    ) -> None:  # fmt: skip
        """Takes the scales of M samples of the flow in each row, [K, B, N, M, A].

        The noise of the draws is standard normal, [K, B, N, M, A]; `value_of` gives the values
        [K, B, N, M] of robots' actions, of which those that are `alive`, [K, B, N], count.
        """
        variance = agent_mean(samples.var(3), alive).clamp(min=1e-6)  # [K]
        spread = variance.sqrt()
        drawn = samples.mean(3, keepdim=True) + spread[:, None, None, None, None] * noise
        values = value_of(drawn.clamp(-1, 1))
        self.slope = (agent_mean(values.std(3), alive) / spread).clamp(min=1e-6)
        self.weight = 2 * self._eta * variance / (samples.shape[4] * self.slope)

    def loss(self, pi: Tensor, values: Tensor, alive: Tensor | None = None) -> Tensor:
        """Returns the loss, [K], whose gradient counts, of pi [K, B, N, A] and values [K, B, N]."""
        pull = bounded_gradient(values, pi, self._limit * self.slope)
        return -self.weight * agent_mean((pull * pi).sum(3), alive)

    def state_dict(self) -> dict[str, Tensor]:
        return {"climb_slope": self.slope.clone(), "climb_weight": self.weight.clone()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self.slope = state["climb_slope"].to(self.slope.device, copy=True)
        self.weight = state["climb_weight"].to(self.weight.device, copy=True)


class MACFlow(OfflineLearner):
    """K seeds of joint flows, their students and two factored critics, trained at once."""

    Config = MACFlowConfig
    FIELDS = TRANSITION
    LOSSES = ("critic_loss", "q", "flow_loss", "distillation_loss", "policy_q", "lambda")
    SPACE: ClassVar[Space] = {
        **ACTOR_CRITIC_SPACE,
        "inverse_temperature": LogUniform(0.3, 10.0),
        "critic_share": Choice((0.5, 0.65, 0.8)),
        "noise": Choice(("team", "own")),
    }

    def __init__(self, setup: Setup, config: MACFlowConfig) -> None:
        self.config, self.first_stage = config, config.first_stage
        self.copy = Distillation(
            setup, config, config.actor_hidden, learning_rate=config.actor_learning_rate
        )
        mixer = chosen_mixer(setup, config.mixer, config.mixer_embedding, config.mixer_hidden)
        self.critics = FactoredCritics(
            setup, config.critic_hidden, mixer,
            learning_rate=config.critic_learning_rate, max_norm=config.max_grad_norm,
        )  # fmt: skip
        self.climb = Climb(
            setup.n_seeds, inverse_temperature=config.inverse_temperature,
            slope_limit=config.slope_limit, device=setup.device,
        )  # fmt: skip
        self.parts = (self.copy, self.critics, self.climb)
        self.generators = setup.generators()
        self.normalizer = Normalizer(setup.statistics, setup.device)
        self.rewards = RobotRewards(setup.statistics, config.reward, clip_target=config.clip_target)

    def update(self, batch: Batch) -> dict[str, Any]:
        """One step on tensors [K, B, ...], windows with a memory; returns losses of what moved."""
        first, scale = self.first_stage, self.scale
        view = self.copy.actor.see(batch)
        batch = view.batch
        s, o = self.normalizer(batch.states, batch.observations)
        x = information(s, o)
        reported: dict[str, Tensor] = {}
        if first == 0 or self.n_updates < first:
            critic_loss, reported = self.critic_loss(view, s, o)
            self.critics.step(critic_loss, scale)
            self.critics.follow(self.config.tau)
            reported["flow_loss"] = self.copy.fit(x, batch, self.generators, scale)
        z = normal_like(self.generators, batch.actions)
        pi = acting(self.copy.actor(view.features, z), batch.alive)  # [K, B, N, A]
        targets = self.copy.targets(x, z, batch, self.generators)
        total = reported["distillation_loss"] = cloning_loss(pi, targets, batch.alive)
        if self.n_updates >= first:
            if first == 0 or not self.climb.is_measured:
                self.measure_climb(s, o, batch)
            climb_loss, reported_of_climb = self.climb_loss(s, o, pi, batch.alive)
            total, reported = total + climb_loss, reported | reported_of_climb
        self.copy.step(total, scale)
        self.n_updates += 1
        return {name: loss.detach() for name, loss in reported.items()}

    def critic_loss(self, view: StudentView, s: Tensor, o: Tensor) -> Loss:
        """Returns sum_j L(Q_j), [K]; draws the noise of the next actions.

        States and observations, [K, B, S] and [K, B, N, O], are normalized.
        """
        y, batch = self.targets(view), view.batch  # y without a gradient
        if self.config.reward == "own":
            q = self.critics.agent_values(o, batch.actions).flatten(2)  # [K, 2, B N]
        else:
            q = self.critics.q(s, o, batch.actions)  # [K, 2, B]
        loss = td_error(q, y, self.rewards.learned(batch))
        return Loss(loss, {"critic_loss": loss, "q": q.mean((1, 2))})

    @torch.no_grad()
    def targets(self, view: StudentView) -> Tensor:
        """Returns y of every robot, [K, B N], or of the team, [K, B]; draws the noise z'."""
        discount, batch = self.config.discount, view.batch
        z = normal_like(self.generators, batch.actions)
        stay = going_on(batch)
        a_next = acting(self.copy.actor(self.copy.actor.see_next(view), z), stay)
        s_next, o_next = self.normalizer(batch.next_states, acting(batch.next_observations, stay))
        r, critics = self.rewards(batch.rewards), self.critics
        if self.config.reward == "own":
            q_next = critics.agent_values(o_next, a_next, critics.target_utilities).amin(1)
            q_next = q_next.clamp(max=self.rewards.max_value)
            return td_target(r, self.rewards.ends(batch), q_next, discount).flatten(1)
        q_next = critics.target_q(s_next, o_next, a_next).amin(1)
        q_next = q_next.clamp(max=self.rewards.max_value)
        return td_target(r[..., 0], batch.terminations, q_next, discount)

    def measure_climb(self, s: Tensor, o: Tensor, batch: Batch) -> None:
        """Measures how far actors may climb, on actions of the data; draws noise.

        States and observations, [K, B, S] and [K, B, N, O], are normalized.
        """
        actions = batch.actions

        def value_of(drawn: Tensor) -> Tensor:  # [K, B, N, M, A] -> [K, B, N, M]
            if self.config.reward == "own":
                return torch.stack([self.critics.own_values(o, a) for a in drawn.unbind(3)], 3)
            return self.critics.candidate_q(s, o, drawn, actions)

        x = information(s, o)
        draws = [[normal_like(self.generators, actions) for _ in range(N_DRAWS)] for _ in range(2)]
        samples = torch.stack([self.copy.flow.sample(x, z, batch.alive) for z in draws[0]], 3)
        self.climb.measure(samples, torch.stack(draws[1], 3), value_of, batch.alive)

    def climb_loss(self, s: Tensor, o: Tensor, pi: Tensor, alive: Tensor | None) -> Loss:
        """Returns - lambda mean_i clip(dQ_i / dmu_i, slope_limit s) mu_i, [K], of pi [K, B, N, A].

        States and observations, [K, B, S] and [K, B, N, O], are normalized.
        """
        if self.config.reward == "own":
            values = self.critics.own_values(o, pi)  # [K, B, N]
            worth = agent_mean(values, alive)
        else:  # equal shares: the gradient of their sum is that of the team's value
            team = self.critics.smallest_q(s, o, pi)  # [K, B]
            values, worth = (team / pi.shape[2])[..., None].expand(pi.shape[:3]), team.mean(1)
        loss = self.climb.loss(pi, values, alive)
        return Loss(loss, {"policy_q": worth, "lambda": self.climb.weight})

    def policy(self, index: int) -> FlowPolicy | RecurrentFlowPolicy:
        return flow_policy(self.copy.actor, index)
