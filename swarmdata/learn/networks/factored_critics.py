"""FactoredCritics: the value of a joint action as a mixture of the values of each agent's action.

    Q_tot(s, o, a) = g(Q_1(o_1, a_1), ..., Q_N(o_N, a_N); x)

(Peng et al. 2021, equation 4.) The agents share one network Q, which sees their number; the mixer g
sees x = (state, all observations), for the reason that `network_inputs.information` gives.
"""

from functools import partial

import torch
from torch import Tensor

from swarmdata.learn.networks.actor import CRITIC_STREAM
from swarmdata.learn.networks.mixers import Mixer, Network
from swarmdata.learn.networks.network_inputs import information, with_agent_id
from swarmdata.learn.networks.optimizer import Descent
from swarmdata.learn.networks.perceptrons import MLPShape, StackedMLP, initialize
from swarmdata.learn.networks.setup import Setup

VALUE_STREAM = 3
"""Stream of a seed's initial parameters, beside those of `actor` and `mixers`."""


class FactoredCritics(Descent):
    """J factored critics of each of K seeds, their targets, and their optimizers.

    States [K, B, S] and observations [K, B, N, O] are normalized, actions [K, B, N, A]. The mixer
    has K J networks, rows as `utilities`; `max_norm` is of one seed's Q_i, and of its mixers.
    """

    def __init__(
        self,
        setup: Setup,
        hidden: tuple[int, ...],
        mixer: Mixer,
        *,
        learning_rate: float,
        max_norm: float | None,
        n_critics: int = 2,
    ) -> None:
        self.n_critics, self.mixer, sizes = n_critics, mixer, setup.sizes
        inputs = sizes.observation + sizes.action + sizes.n_agents
        shape = MLPShape(inputs, hidden, 1, layer_norm=True)
        # the networks Q_i: rows are seed 0 critic 0, seed 0 critic 1, seed 1 critic 0, ...
        self.utilities = StackedMLP(shape, n_critics * setup.n_seeds, setup.device)
        initialize(self.utilities, setup.seeds, CRITIC_STREAM)
        networks = {"utilities": self.utilities}
        if mixer.network is not None:
            networks["mixer"] = mixer.network
        super().__init__(networks, setup.n_seeds, learning_rate, max_norm, followed=networks)
        self.target_utilities: StackedMLP = self.targets["utilities"]
        self.target_mixer: StackedMLP | None = self.targets.get("mixer")  # if it learns

    def q(
        self, states: Tensor, observations: Tensor, actions: Tensor, alive: Tensor | None = None
    ) -> Tensor:
        """Returns all critics' Q_tot, [K, J, B]; agents that are not `alive` are worth 0."""
        x = information(states, observations).repeat_interleave(self.n_critics, 0)
        values = self.agent_values(observations, actions)
        if alive is not None:
            values = values * alive[:, None]
        mixed = self.mixer(values.flatten(0, 1), x)  # of [K J, B, N]
        return mixed.view(-1, self.n_critics, x.shape[1])

    def target_q(self, states: Tensor, observations: Tensor, actions: Tensor) -> Tensor:
        x = information(states, observations).repeat_interleave(self.n_critics, 0)
        values = self.agent_values(observations, actions, self.target_utilities).flatten(0, 1)
        return self.mixer(values, x, self.target_mixer).view(-1, self.n_critics, x.shape[1])

    def agent_values(
        self, observations: Tensor, actions: Tensor, network: Network | None = None
    ) -> Tensor:
        """Returns Q_i of every agent, [K, J, B, N], by the utilities or another network."""
        inputs = _inputs(observations, actions).repeat_interleave(self.n_critics, 0)
        values = (network or self.utilities)(inputs)
        return values.view(-1, self.n_critics, *actions.shape[1:3])

    def policy_values(self, states: Tensor, observations: Tensor, pi: Tensor) -> Tensor:
        """Returns the first critics' Q_tot, [K, B]; all parameters are constants."""
        every = self.n_critics
        values = self.utilities.frozen(_inputs(observations, pi), every).view(pi.shape[:3])
        known = self.mixer.network
        mixer = None if known is None else partial(known.frozen, every=every)
        return self.mixer(values, information(states, observations), mixer)

    def smallest_q(self, states: Tensor, observations: Tensor, pi: Tensor) -> Tensor:
        """Returns the smallest of the J values, [K, B]; all parameters are constants."""
        x = information(states, observations).repeat_interleave(self.n_critics, 0)
        values = self.agent_values(observations, pi, self.utilities.frozen).flatten(0, 1)
        return self._frozen_mix(values, x).view(-1, self.n_critics, x.shape[1]).amin(1)

    def own_values(self, observations: Tensor, pi: Tensor) -> Tensor:
        """Returns the smallest of the J values of each agent, [K, B, N]; constants as above."""
        return self.agent_values(observations, pi, self.utilities.frozen).amin(1)

    @torch.no_grad()
    def candidate_q(
        self, states: Tensor, observations: Tensor, candidates: Tensor, actions: Tensor
    ) -> Tensor:
        """Returns the smallest value if one robot alone leaves the data, [K, B, N, M].

        `candidates` are [K, B, N, M, A], of which a robot takes one; `actions` are the data's.
        """
        n_agents, n_candidates = candidates.shape[2:4]
        x = information(states, observations).repeat_interleave(self.n_critics, 0)
        x = x.repeat_interleave(n_candidates, 1)  # [K J, B M, S + N O]
        frozen = self.utilities.frozen
        taken = self.agent_values(observations, actions, frozen).flatten(0, 1)  # [K J, B, N]
        taken = taken.repeat_interleave(n_candidates, 1)  # [K J, B M, N]
        others = [self.agent_values(observations, a, frozen) for a in candidates.unbind(3)]
        varied = torch.stack(others, 3).flatten(0, 1).flatten(1, 2)  # [K J, B M, N]
        results = []
        for robot in range(n_agents):
            mixed = taken.clone()
            mixed[..., robot] = varied[..., robot]
            values = self._frozen_mix(mixed, x)  # [K J, B M]
            results.append(values.view(-1, self.n_critics, len(actions[0]), n_candidates).amin(1))
        return torch.stack(results, 2)

    def _frozen_mix(self, values: Tensor, x: Tensor) -> Tensor:
        """Q_tot of all critics, [K J, B], with parameters as constants."""
        known = self.mixer.network
        return self.mixer(values, x, None if known is None else known.frozen)


def _inputs(observations: Tensor, actions: Tensor) -> Tensor:
    """What Q_i sees: the agent's observation, action and number, [K, B N, O + A + N]."""
    return with_agent_id(torch.cat([observations, actions], -1)).flatten(1, 2)
