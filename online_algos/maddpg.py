"""MADDPG: actors that act on their own observations, trained with critics that see everything.

Lowe et al., "Multi-agent actor-critic for mixed cooperative-competitive environments", NeurIPS
2017, equations 5 and 6; with the corrections of TD3 (Fujimoto et al. 2018, algorithm 1) it is MATD3
(Ackermann et al. 2019, section 4). With the reward r_i of robot i, its value Q_j by critic j, and
x_i = (o_i, i, s) for what the critics see of robot i besides the actions of all:

    (1) y_i    = r_i + gamma (1 - termination) min_j Q'_j(x'_i, pi'(o') + clip(noise, -c, c))
    (2) L(Q_j) = 1/N sum_i Huber(Q_j(x_i, a) - y_i)                          every gradient step
    (3) L(pi)  = -1/N sum_i Q_1(x_i, pi(o)) + w |logits of pi(o)|^2          every `policy_delay`-th

`corrections` "none" is the original: one critic, no smoothing noise, no delay. `critic`
"decentralized" sees (o_i, i, a_i) only.

Started from an offline run (`continuation.offline_start`), it goes on with its actors, and with its
critics if they are of each robot's own reward. The actors rest in the first
`critic_warmup_updates`, in which critics learn what the present actors are worth: those of a second
stage value the actors of the first one, and new ones know nothing.

Deviations:
- The critics are those of `offline_algos.maddpg_bc`, one network for all robots. The robots are a
  team: all climb the mean of the values.
- `joint_gradient` "all": every robot's action in Q comes from its policy (the centralized gradient
  of FACMAC, Peng et al. 2021, equation 7). "own" is the paper's equation 5: robot i's action comes
  from its policy, the others' from the replay.
- `parameters` "shared": one actor for all robots, which sees the robot's number; the paper's robots
  have one each ("separate").
- The critics have LayerNorm; Huber loss instead of squares; inputs are normalized by their moments
  under random actions, or by those of the offline run; actions and observations are turned to the
  robot's target (`frame`).
- w is the weight that the paper's code puts on the actor's outputs before they are squashed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import torch
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from swarmdata.learn.networks.actor import ACTOR_STREAM
from swarmdata.learn.networks.critics import (
    Critic,
    JointGradient,
    RobotCritics,
    RobotView,
    others_of,
)
from swarmdata.learn.networks.network_inputs import (
    generator_states,
    generators,
    normal_like,
    restore_generators,
    uniform_like,
)
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP
from swarmdata.learn.networks.setup import Sizes
from swarmdata.learn.networks.team_networks import Team
from swarmdata.learn.objectives.losses import td_target
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.online_algos.collection.input_moments import InputMoments, SeedNormalizer
from swarmdata.online_algos.collection.replay_collection import OffPolicy, ReplaySettings, gaussian
from swarmdata.online_algos.continuation.offline_start import (
    OfflineStart,
    actor_of,
    as_text,
    frame_name,
    hidden_sizes,
    load_actors,
    load_critics,
    robot_critics_of,
    settings_of_critics,
)
from swarmdata.specs.features import Feature
from swarmdata.types import Batch

WHEN_STARTED = {
    "warmup_actions": "policy",
    "critic_warmup_updates": "2000",  # of new critics; 500 of those that go on
    "noise": "0.2",
    "actor_learning_rate": "3e-4",
}
"""Settings of a training that starts from an offline run, where the user gives no others.

The policy acts for a while before anything learns (WSRL, Zhou et al. 2025, arXiv 2412.07762), and
critics learn for a while before it moves. Figures are in docs/online-learning.md."""

NOISE_STREAM = 2
"""Stream of a seed's smoothing noise; the networks have the streams before it."""


@dataclass(frozen=True)
class MADDPGConfig(ReplaySettings):
    """Settings of MADDPG."""

    NEEDS: ClassVar[Mapping[str, Any]] = {
        **dict.fromkeys(("policy_delay", "smoothing", "smoothing_clip"), ("corrections", ("td3",))),
        "joint_gradient": ("critic", ("centralized",)),
    }

    n_gradient_steps: int = 2
    batch_size: int = 256
    warmup_actions: Literal["random", "policy"] = "random"  # in the warm-up; `policy`: with noise
    critic_warmup_updates: int = 0  # gradient steps in which only the critics learn
    corrections: Literal["td3", "none"] = "td3"
    critic: Critic = "centralized"
    joint_gradient: JointGradient = "all"
    actor_hidden: tuple[int, ...] = (64, 64)
    critic_hidden: tuple[int, ...] = (128, 128)
    actor_learning_rate: float = 1e-3
    critic_learning_rate: float = 1e-3
    tau: float = 0.03  # per step of the actors; 0.01 follows in 200 gradient steps
    policy_delay: int = 2  # Fujimoto et al. 2018, section 6.1
    smoothing: float = 0.1  # half of the paper's; not compared alone
    smoothing_clip: float = 0.5  # c
    logit_penalty: float = 1e-3  # w, from the code of Lowe et al.
    noise: float = 0.5  # deviation of exploring actions
    final_noise: float = 0.1
    exploration: float = 0.5  # part of training in which the noise falls

    @property
    def n_critics(self) -> int:
        """Critics of one seed, J."""
        return 2 if self.corrections == "td3" else 1

    @property
    def delay(self) -> int:
        """Steps of the critics for one of the actors."""
        return self.policy_delay if self.corrections == "td3" else 1


class Learner:
    """K seeds of actors and critics, trained on batches of observations and states as seen."""

    LOSSES = ("critic_loss", "q", "policy_q")

    def __init__(
        self, sizes: Sizes, moments: InputMoments, seeds: Sequence[int], config: MADDPGConfig
    ) -> None:
        self.config, self.n_updates = config, 0
        self.inputs = SeedNormalizer(moments)
        shape = MLPShape(sizes.observation, config.actor_hidden, sizes.action)
        self.actors = Team(
            shape, sizes.n_agents, seeds, ACTOR_STREAM, parameters=config.parameters, device="cpu"
        )
        self.critics = RobotCritics(
            sizes, self.inputs, config.critic, seeds, config.critic_hidden,
            learning_rate=config.critic_learning_rate, max_norm=config.max_grad_norm,
            n_critics=config.n_critics,
        )  # fmt: skip
        self.descent = Descent(
            {"actors": self.actors.network}, len(seeds), config.actor_learning_rate,
            config.max_grad_norm, followed=("actors",), moments={"actors": "actor_adam"},
        )  # fmt: skip
        self.target_actors: StackedMLP = self.descent.targets["actors"]
        self.generators = generators(seeds, "cpu", NOISE_STREAM)

    def actions(self, observations: Tensor, network: StackedMLP | None = None) -> Tensor:
        """Returns actions, [K, B, N, A], of normalized observations [K, B, N, O]."""
        return self.actors(observations, network).tanh()

    def update(self, batch: Batch, scale: float = 1.0) -> dict[str, Tensor]:
        """One step on tensors [K, B, ...]; returns losses [K], the actors' only when they move."""
        x = self.critics.view(batch.states, batch.observations)
        losses = self._update_critics(batch, x, scale)
        self.n_updates += 1
        if self.n_updates % self.config.delay == 0:
            if self.n_updates > self.config.critic_warmup_updates:
                losses |= self._update_actors(batch, x, scale)
                self.descent.follow(self.config.tau)
            self.critics.follow(self.config.tau)
        return {name: loss.detach() for name, loss in losses.items()}

    @torch.no_grad()
    def targets(self, batch: Batch) -> Tensor:
        """Returns y, [K, B, N], in units of scaled rewards; draws the smoothing noise, if any."""
        config = self.config
        o_next = batch.next_observations
        a_next = self.actions(self.inputs.observations(o_next), self.target_actors)
        if config.corrections == "td3":
            noise = config.smoothing * normal_like(self.generators, a_next)
            a_next = a_next + noise.clamp(-config.smoothing_clip, config.smoothing_clip)
        x_next = self.critics.view(batch.next_states, o_next)
        q_next = self.critics.target_q(x_next, a_next.clamp(-1, 1)).amin(1)  # [K, B, N]
        r = batch.rewards * config.reward_scale
        return td_target(r, batch.terminations[..., None], q_next, config.discount)  # (1)

    def _update_critics(self, batch: Batch, x: RobotView, scale: float) -> dict[str, Tensor]:
        y = self.targets(batch)  # [K, B, N]
        q = self.critics.q(x, batch.actions)  # [K, J, B, N]
        errors = smooth_l1_loss(q, y[:, None].expand_as(q), reduction="none")
        loss = errors.mean((2, 3)).sum(1)  # [K]  (2)
        self.critics.step(loss, scale)
        return {"critic_loss": loss, "q": q.mean((1, 2, 3))}

    def _update_actors(self, batch: Batch, x: RobotView, scale: float) -> dict[str, Tensor]:
        logits = self.actors(self.inputs.observations(batch.observations))
        pi = logits.tanh()
        others = others_of(self.config.joint_gradient, pi, batch.actions)
        q = self.critics.first_q(x, pi, others).mean((1, 2))  # [K]; parameters are constants
        penalty = self.config.logit_penalty * logits.square().mean((1, 2, 3))
        self.descent.step(penalty - q, scale)  # (3)
        return {"policy_q": q}

    def state_dict(self) -> dict[str, Tensor]:
        """Parameters, targets, Adam's moments, generators and number of updates, as copies."""
        return {
            "n_updates": torch.tensor(self.n_updates),
            "generators": generator_states(self.generators),
            **self.descent.state_dict(),
            **self.critics.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self.n_updates = int(state["n_updates"])
        restore_generators(self.generators, state["generators"])
        self.descent.load_state_dict(state)
        self.critics.load_state_dict(state)


class MADDPG(OffPolicy):
    """K seeds of MADDPG in worlds of their own."""

    Config = MADDPGConfig
    LOSSES = (*Learner.LOSSES, "reward")

    def new_learner(self) -> Learner:
        return Learner(self.worlds.sizes, self.moments, self.seeds, self.config)

    @staticmethod
    def settings_of(start: OfflineStart, features: Sequence[Feature]) -> dict[str, str]:
        """Returns the settings of the run's actors, and `WHEN_STARTED`."""
        actor, critics = actor_of(start, squash=True), robot_critics_of(start)
        values = {} if isinstance(critics, str) else settings_of_critics(start, critics)
        return {
            "actor_hidden": as_text(hidden_sizes(actor.layers)),
            "parameters": actor.parameters,
            "frame": frame_name(actor.frame, features),
            **WHEN_STARTED,
            **values,
        }

    def start_from(self, start: OfflineStart) -> list[str]:
        """Takes over actors, their inputs' statistics, and critics that fit; tells if none do."""
        self.moments = start.moments(len(self.seeds))
        self.learner = self.new_learner()
        network = self.learner.actors.network
        load_actors(start, self.seeds, self.policy(0), network)
        self.learner.target_actors.load(network.flat)
        return load_critics(self.learner.critics, start, self.seeds)

    def explore(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        actions = self.learner.actions(observations)
        is_warm = self.frames >= self.config.warmup_transitions
        if not is_warm and self.config.warmup_actions == "random":
            actions = 2 * uniform_like(self.acting, actions) - 1
        else:
            noise = self.faded(self.config.noise, self.config.final_noise)
            actions = gaussian(self.acting, actions, noise)
        return actions, actions

    def learn(self, batch: Batch, scale: float) -> dict[str, Tensor]:
        return self.learner.update(batch, scale)

    def policy(self, index: int) -> TorchPolicy:
        mean, std = self.inputs_of(index)
        return TorchPolicy(
            layers=self.learner.actors.extract(index),
            observation_mean=mean,
            observation_std=std,
            squash=True,
            frame=self.frame,
            parameters=self.config.parameters,
        )
