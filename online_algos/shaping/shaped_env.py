"""ShapedEnv, copies of a task whose rewards are changed to train on.

The physics, the observations and the ends of episodes stay those of the task; policies are measured
on the task's own rewards.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from swarmdata.analysis.passings import ENCOUNTER_DISTANCE, HEAD_ON_MAX_COSINE, MOVING_MIN_SPEED
from swarmdata.errors import SchemaError
from swarmdata.interfaces import VecEnv
from swarmdata.online_algos.shaping.payload_potentials import PayloadPotential
from swarmdata.registry.components import make_env
from swarmdata.specs.rules import Rewards, Side
from swarmdata.specs.state_layout import VX, VY, X, Y, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Seeds, Step

RewardTerm = Callable[[Float, Step, Step, float], Float]
"""One change of the rewards.

It takes the rewards of the task, changed by the terms before it, [E, N]; the step in which the
robots acted; the next step, before any reset; and the part of the training that is done, in [0, 1].
It returns the changed rewards, float32 [E, N]."""


def with_team_share(
    rewards: Float, before: Step, after: Step, progress: float,
    *, share: float, sides: Sequence[Side],
) -> Float:  # fmt: skip
    """Mixes every robot's reward with its side's: (1 - share) r_i + share mean_j r_j, [E, N]."""
    parts = (rewards[:, side.agents.start : side.agents.stop] for side in sides)
    mixed = [(1 - share) * part + share * part.mean(1, keepdims=True) for part in parts]
    return np.concatenate(mixed, axis=1)


def less_contacts(
    rewards: Float, before: Step, after: Step, progress: float,
    *, weights: Rewards, cost: float, ramp: Sequence[float],
) -> Float:  # fmt: skip
    """Subtracts c(p) times the task's own costs of contacts and collisions, [E, N].

        c(p) = cost clip((p - begin) / (end - begin), 0, 1)      p: part of the training done

    A high cost from the start prevents learning; a low one leaves a policy that brushes past
    obstacles.

    `weights` hold the task's costs, `ramp` begin and end.
    """
    task_costs = [
        weights.robot_contact, weights.obstacle_contact,
        weights.robot_collision, weights.obstacle_collision,
    ]  # as `types.EVENTS`  # fmt: skip
    begin, end = ramp
    factor = cost * min(1.0, max(0.0, (progress - begin) / (end - begin)))
    changed: Float = rewards - factor * (after.events @ np.array(task_costs, np.float32))
    return changed


def less_oncoming(
    rewards: Float, before: Step, after: Step, progress: float, *, right: float, left: float
) -> Float:
    """Subtracts a cost for each oncoming robot on the right and on the left, in each step, [E, N].

    A robot that keeps to the right has oncoming robots on its left, so a cost of those on the right
    teaches it to keep right.
    """
    n_right, n_left = count_oncoming(after)
    changed: Float = rewards - (np.float32(right) * n_right + np.float32(left) * n_left)
    return changed


def count_oncoming(step: Step) -> tuple[Float, Float]:
    """Returns how many oncoming robots each robot has on its right and on its left, each [E, N].

    Two robots are oncoming while they are closer than `passings.ENCOUNTER_DISTANCE`, both move,
    their velocities point against each other, and they have not passed. A robot exactly ahead is on
    neither side.
    """
    robots = robots_of(step.states, step.rewards.shape[1])
    positions, velocities = robots[..., [X, Y]], robots[..., [VX, VY]]
    gap = positions[:, None] - positions[:, :, None]  # [E, i, j, 2], from i to j
    speeds = np.sqrt(np.square(velocities).sum(-1))
    products = (velocities[:, :, None] * velocities[:, None]).sum(-1)
    moving = (speeds > MOVING_MIN_SPEED)[:, :, None] & (speeds > MOVING_MIN_SPEED)[:, None]
    opposed = products < HEAD_ON_MAX_COSINE * speeds[:, :, None] * speeds[:, None]
    near = np.square(gap).sum(-1) < ENCOUNTER_DISTANCE**2
    ahead = (gap * velocities[:, :, None]).sum(-1) > 0
    side = velocities[:, :, None, 0] * gap[..., 1] - velocities[:, :, None, 1] * gap[..., 0]
    oncoming = moving & opposed & near & ahead
    n_right = (oncoming & (side < 0)).sum(-1).astype(np.float32)
    n_left = (oncoming & (side > 0)).sum(-1).astype(np.float32)
    return n_right, n_left


@dataclass(frozen=True)
class ShapingConfig:
    """What is changed in a task's rewards, in the order in which it is applied."""

    reward_weights: tuple[str, ...] = ()  # to replace the spec's, such as "proximity=2"
    contact_cost: float = 1.5  # extra contact and collision costs at the end, times the spec's
    contact_ramp: tuple[float, ...] = (0.2, 0.75)  # part of training in which they grow from 0
    keep_right: float = 0.0  # cost per step of an oncoming robot on the right
    keep_left: float = 0.0  # cost per step of an oncoming robot on the left
    team_share: float = 0.3  # part of each reward that is the team's mean
    payload_path_weight: float = 0.0  # reward per metre by which a payload's path gets shorter
    behind_payload_weight: float = 0.0  # half the reward for moving from in front to behind

    def __post_init__(self) -> None:
        if len(self.contact_ramp) != 2 or self.contact_ramp[0] >= self.contact_ramp[1]:
            raise SchemaError(
                f"contact_ramp is {self.contact_ramp}, expected two parts of training, begin "
                "before end, such as 0.2,0.75; for the whole cost from the start, -1,0"
            )


class ShapedEnv:
    """Implements `interfaces.VecEnv`: the copies of another, with shaped rewards.

    `reward_terms` stay those of the task; `terms` are applied one after the other.
    """

    def __init__(self, env: VecEnv, terms: Sequence[RewardTerm]) -> None:
        # progress: part of the training that is done, in [0, 1]; set by the trainer
        self.env, self.terms, self.progress = env, tuple(terms), 0.0
        self.spec, self.task, self.n_copies = env.spec, env.task, env.n_copies
        self.features, self.observation_size = env.features, env.observation_size
        self.action_size, self.state_size = env.action_size, env.state_size
        self._current_step: Step | None = None

    def reset(self, seeds: Seeds, copies: Int | None = None) -> Step:
        step = self.env.reset(seeds, copies)
        if self._current_step is not None and copies is not None:
            rewards = self._current_step.rewards.copy()  # the other copies keep theirs
            rewards[copies] = 0
            step = step._replace(rewards=rewards)
        self._current_step = step
        return step

    def step(self, actions: Float | Double) -> Step:
        """Advances the copies that have not ended and shapes their rewards."""
        before, after = self._current_step, self.env.step(actions)
        if before is None:
            raise SchemaError("step was called before the first reset; call env.reset(seeds) first")
        rewards = after.rewards
        for term in self.terms:
            rewards = term(rewards, before, after, self.progress)
        self._current_step = after._replace(rewards=rewards)
        return self._current_step

    def close(self) -> None:
        self.env.close()


def shape_rewards(env: VecEnv, config: ShapingConfig) -> ShapedEnv:
    """Returns copies with the rewards that a config describes; weights of 0 are left out.

    Raises:
        SpecError: a reward weight does not exist or cannot have its value, or there is a potential
            of payloads in a task without payloads.
    """
    env = reweighted(env, config.reward_weights)
    terms: list[RewardTerm] = []
    if config.contact_cost:
        weights, ramp = env.spec.rules.rewards, config.contact_ramp
        terms.append(partial(less_contacts, weights=weights, cost=config.contact_cost, ramp=ramp))
    if config.keep_right or config.keep_left:
        terms.append(partial(less_oncoming, right=config.keep_right, left=config.keep_left))
    if config.team_share:
        terms.append(partial(with_team_share, share=config.team_share, sides=env.spec.sides))
    if config.payload_path_weight or config.behind_payload_weight:
        path, behind = config.payload_path_weight, config.behind_payload_weight
        terms.append(PayloadPotential(env.spec, env.n_copies, path, behind))
    return ShapedEnv(env, terms)


def reweighted(env: VecEnv, weights: Sequence[str]) -> VecEnv:
    """Returns copies of the same task with other reward weights, such as "proximity=2"."""
    if not weights:
        return env
    rules = env.spec.rules.model_dump(mode="json")
    pairs = (text.partition("=") for text in weights)
    rules["rewards"] |= {name.strip(): value.strip() for name, _, value in pairs}
    changed = env.spec.model_dump(mode="json") | {"rules": rules}
    n_threads: int = getattr(env, "n_threads", 1)  # other kinds of environments have one
    return make_env(TaskSpec.parse(changed, "rewards"), env.n_copies, n_threads=n_threads)
