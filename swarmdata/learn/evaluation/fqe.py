"""Fitted Q evaluation: what policies are worth, estimated from recorded data alone.

Le, Voloshin & Yue, "Batch Policy Learning under Constraints", ICML 2019, algorithm 3; the form with
a slowly moving target network is that of Fu et al., "Benchmarks for Deep Off-Policy Evaluation",
ICLR 2021, appendix. For a team with reward r, the mean over agents, and the deterministic joint
policy pi:

    y        = r + gamma (1 - termination) clip(Q'(x', pi(o')), low, high)
    L(Q)     = (Q(x, a) - y)^2                        over the train split
    V(pi)    = mean over initial states of Q(x, pi(o))

Deviations:
- x = (state, all observations), as the critics of the actor-critic algorithms here see it; inputs
  are normalized, rewards divided by the standard deviation of the returns-to-go, critics have
  LayerNorm, and the learning rate decays along a cosine.
- The bootstrap goes on through truncations, so V is the value of a task without a horizon. It goes
  on where one agent is cut, too; later steps without that agent are left out.
- `clip` guards against divergence: with all non-terminal team rewards of the data in [r-, r+] and
  all terminal ones in [t-, t+], no policy that meets only such rewards has a value outside
  [min(r- / (1 - gamma), t-), max(r+ / (1 - gamma), t+)].
- Common random numbers: the critics of all K policies start from the same parameters and see the
  same batches, so that what differs between their values is due to the policies.

Far from the data, values are too high: nothing holds a critic down there. `imitation_error` tells
such policies.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from swarmdata.errors import DivergedError, SchemaError
from swarmdata.learn.evaluation.transitions import Transitions, actions_of
from swarmdata.learn.networks.critics import Critics
from swarmdata.learn.networks.optimizer import cosine
from swarmdata.learn.objectives.losses import td_target
from swarmdata.learn.training.training_data import Data
from swarmdata.numerics.random import derive, uniform
from swarmdata.types import Double, Int

N_CURVE_POINTS = 10
"""Of the curve of values while they are fitted."""

CHUNK_SIZE = 1024  # transitions at once


@dataclass(frozen=True)
class FQEConfig:
    """How values are fitted; one setting for all datasets."""

    n_updates: int = 3_000
    batch_size: int = 256
    hidden: tuple[int, ...] = (128, 128)
    n_fits: int = 1  # critics of each policy, which begin with parameters of their own
    discount: float = 0.99
    learning_rate: float = 1e-3
    tau: float = 0.2
    max_grad_norm: float = 10.0
    seed: int = 0

    def __post_init__(self) -> None:
        if min(self.n_updates, self.batch_size, self.n_fits) < 1 or not 0 <= self.discount < 1:
            raise SchemaError(
                f"{self}: expected at least 1 update, row and fit, and a discount from 0 to below 1"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Values:
    """What K policies are worth, in units of discounted team return, by each of M fits."""

    values: Double  # of every initial state, [K, M, E]
    curve: Double
    """Means over initial states on the way, [P, K, M]; one that still moves has not settled."""
    residual: Double  # root mean square of Q - y on held-out transitions, [K, M]
    clipped: Double
    """Share of the targets of the last tenth of the updates that the bound cut, [K, M]."""
    bound: tuple[float, float]  # the attainable range

    @property
    def mean(self) -> Double:
        """V of each policy: the mean over fits and initial states, [K]."""
        return np.asarray(self.values.mean(axis=(1, 2)))


def attainable(data: Transitions, discount: float) -> tuple[float, float]:
    """Returns the least and the greatest value of policies that meet only rewards of the data."""
    rewards, last = data.rewards.double(), data.terminations
    ends = [side for side in (rewards[~last] / (1 - discount), rewards[last]) if len(side)]
    lows, highs = (
        [float(bound) for bound in pair] for pair in zip(*map(torch.aminmax, ends), strict=True)
    )
    return min(lows), max(highs)


@dataclass(frozen=True, slots=True, eq=False)
class Answered:
    """A split, and what K policies do in each of its states."""

    data: Transitions
    answers: Tensor  # [K, n + E, N, A]

    @classmethod
    def by(cls, policies: Sequence[object], dataset: Data, data: Transitions) -> "Answered":
        """Asks the policies.

        Raises:
            SchemaError: a policy does not tell its actions, or was trained on other observations.
        """
        return cls(data, torch.from_numpy(actions_of(policies, dataset)).to(data.x.device))

    def ask(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Returns x [K, B, S + N O] of rows [B] of x, and the policies' actions [K, B, N, A]."""
        return self.data.x[rows].expand(len(self.answers), -1, -1), self.answers[:, rows]


class FittedQ:
    """K M critics, M for each of K policies, fitted on the same batches; rewards over `scale`."""

    def __init__(self, train: Answered, scale: float, config: FQEConfig) -> None:
        self.train, self.scale, self.config, self.n_updates = train, scale, config, 0
        self.bound = attainable(train.data, config.discount)
        seeds = [config.seed] * len(train.answers)  # common random numbers
        sizes = train.data.sizes
        self.critics = Critics(
            sizes.information + sizes.n_agents * sizes.action, seeds, config.hidden,
            learning_rate=config.learning_rate, max_norm=config.max_grad_norm,
            n_critics=config.n_fits, device=train.answers.device,
        )  # fmt: skip

    def update(self, index: Tensor) -> Tensor:
        """One step on the transitions `index`, [B]; returns the shares of clipped y, [K, M]."""
        y, clipped = self.targets(self.train, index)
        loss = (self.taken(self.train, index) - y).square().mean(2).sum(1)  # [K]
        self.critics.step(loss, cosine(self.n_updates, self.config.n_updates))
        self.critics.follow(self.config.tau)
        self.n_updates += 1
        return clipped

    @torch.no_grad()
    def targets(self, split: Answered, index: Tensor) -> tuple[Tensor, Tensor]:
        """Returns y, [K, M, B], in units of `scale`, and the share that was clipped, [K, M]."""
        data, next_rows = split.data, split.data.rows[index] + 1
        q_next = self.critics.target_q(*split.ask(next_rows))[..., 0]
        low, high = (bound / self.scale for bound in self.bound)
        bounded = q_next.clamp(low, high)
        rewards = data.rewards[index] / self.scale
        y = td_target(rewards, data.terminations[index], bounded, self.config.discount)
        return y, (bounded != q_next).float().mean(2)

    def taken(self, split: Answered, index: Tensor) -> Tensor:
        """Returns Q of the recorded actions, [K, M, B], in units of `scale`."""
        data, n_policies = split.data, len(split.answers)
        x, actions = data.x[data.rows[index]], data.actions[index]
        wide = (part.expand(n_policies, *part.shape) for part in (x, actions))
        return self.critics.q(*wide)[..., 0]

    @torch.no_grad()
    def initial_values(self, split: Answered) -> Double:
        """Returns what the policies are worth from each episode's first state, [K, M, E]."""
        values = self.critics.q(*split.ask(split.data.first))[..., 0]
        result: Double = (values.double() * self.scale).cpu().numpy()
        return result

    @torch.no_grad()
    def residual(self, split: Answered) -> Double:
        """Returns the root mean square of Q - y over a whole split, [K, M]."""
        shape = len(split.answers), self.config.n_fits
        total = torch.zeros(shape, dtype=torch.float64, device=split.answers.device)
        rows = split.data.whole
        for start in range(0, len(rows), CHUNK_SIZE):
            index = rows[start : start + CHUNK_SIZE]
            error = self.taken(split, index) - self.targets(split, index)[0]
            total += error.double().square().sum(2)
        result: Double = ((total / len(rows)).sqrt() * self.scale).cpu().numpy()
        return result


def fitted_q_evaluation(
    train: Answered, held_out: Answered, scale: float, config: FQEConfig, *, progress: bool = True
) -> Values:
    """Fits critics of K policies on a split; says what they are worth from another's first states.

    `scale` is a typical size of returns, such as the deviation of the returns-to-go. Raises
    DivergedError if a value became infinite or NaN.
    """
    fitted, learned = FittedQ(train, scale, config), train.data.whole
    last, curve, clipped = config.n_updates * 9 // 10, [], []
    points = {round(config.n_updates * (k + 1) / N_CURVE_POINTS) for k in range(N_CURVE_POINTS)}
    hidden = None if progress else True  # None: hidden where there is no terminal
    for update in tqdm(range(config.n_updates), desc="FQE", file=sys.stderr, disable=hidden):
        drawn = torch.from_numpy(draws(len(learned), config, update)).to(learned.device)
        shares = fitted.update(learned[drawn])
        if update >= last:
            clipped.append(shares)
        if update + 1 in points:
            curve.append(fitted.initial_values(held_out).mean(2))
            _check_finite(curve[-1], update + 1)
    return Values(
        values=fitted.initial_values(held_out),
        curve=np.stack(curve),
        residual=fitted.residual(held_out),
        clipped=torch.stack(clipped).mean(0).double().cpu().numpy(),
        bound=fitted.bound,
    )


def _check_finite(values: Double, update: int) -> None:
    if not np.isfinite(values).all():
        raise DivergedError(
            f"fitted Q evaluation diverged: at update {update:,}, {(~np.isfinite(values)).sum()} "
            f"of {values.size} values are not finite. Take a smaller learning_rate or smaller "
            "rewards."
        )


def draws(n_rows: int, config: FQEConfig, update: int) -> Int:
    """Returns the transitions of one update, [B]: uniform, with replacement."""
    numbers = np.arange(config.batch_size, dtype=np.uint64) + np.uint64(update * config.batch_size)
    picks = uniform(derive(config.seed, numbers)) * n_rows
    return np.minimum(picks, n_rows - 1).astype(np.int64)  # the product may round up to n_rows


N_BATCHES, BATCH_SIZE = 32, 256
"""Held-out transitions on which a TD error is measured."""


def imitation_error(split: Answered) -> Double:
    """Returns what behavior cloning minimizes: mean |pi(o_i) - a_i|^2 / A of who acts, [K]."""
    return _mean_error(split, torch.ones_like(split.data.returns, dtype=torch.float64))


def weighted_imitation_error(split: Answered) -> Double:
    """Returns the imitation error with more weight on what went well, [K].

    The weight of a step is exp((G - mean G) / std G) with its return-to-go G, the weight of
    exponentially weighted imitation (Wang et al. 2018, "Exponentially Weighted Imitation Learning
    for Batched Historical Data", eq. 4, beta = 1) with the mean in place of a value function.
    """
    returns = split.data.returns.double()
    spread = returns.std(correction=0)
    weights = torch.exp((returns - returns.mean()) / torch.where(spread > 0, spread, 1.0))
    return _mean_error(split, weights)


def _mean_error(split: Answered, weights: Tensor) -> Double:
    """Mean squared errors of the actions of robots that act, by weights of the steps, [n]."""
    data = split.data
    squares = (split.answers[:, data.rows] - data.actions).square() * data.acting[:, :, None]
    errors, shares = squares.mean((2, 3)).double(), data.acting.double().mean(1)
    result: Double = ((errors * weights).sum(1) / (weights * shares).sum()).cpu().numpy()
    return result


@torch.no_grad()
def td_errors(
    algorithm: Any, dataset: Data, n_seeds: int, device: torch.device | str
) -> Double | None:
    """Returns the root mean square of Q - y of an algorithm's own critics, [K], if it has any.

    In units of rewards, but of its own discount and target: comparable between seeds and settings
    of one algorithm at best.
    """
    if not hasattr(algorithm, "td_error"):
        return None
    sampler = dataset.sampler(BATCH_SIZE, seed=0)
    total = np.zeros(n_seeds)
    for _ in range(N_BATCHES):
        index = np.broadcast_to(sampler.draw(), (n_seeds, BATCH_SIZE))
        total += algorithm.td_error(sampler.gather(index).to_torch(device)).cpu().numpy()
    result: Double = np.sqrt(total / N_BATCHES)
    return result
