"""The actions of recorded environments as policies see them: mapped to [-1, 1], or as choices."""

from dataclasses import dataclass

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.specs.origins import Spec
from swarmdata.specs.spaces import (
    DictSpace,
    DiscreteSpace,
    MultiBinarySpace,
    MultiDiscreteSpace,
    Space,
    TupleSpace,
    bounds,
    is_continuous,
    parts_of,
)
from swarmdata.types import Double, Float

BOUND_TOLERANCE = 1e-5
"""How far outside [-1, 1] a recorded action may lie, because environments round."""


@dataclass(frozen=True, slots=True, eq=False)
class ActionScale:
    """unit = (action - middle) / half, for each agent and column; padding is 0 on both sides.

    A column with a single possible value has it as its middle, and half 1.
    """

    middle: Double  # [N, A]
    half: Double  # [N, A], positive

    @property
    def is_identity(self) -> bool:
        """Whether every action of the environment is in [-1, 1] already."""
        return not self.middle.any() and bool((self.half == 1).all())

    def relative(self, actions: Float | Double) -> Double:
        """Returns actions [..., N, A] of the environment in [-1, 1] if they are in their bounds."""
        found: Double = (actions.astype(np.float64) - self.middle) / self.half
        return found

    def to_unit(self, actions: Float) -> Float:
        """Returns actions [..., N, A] of the environment as numbers in [-1, 1].

        Raises:
            SchemaError: an action lies outside its bounds.
        """
        unit = self.relative(actions)
        beyond = np.abs(unit) > 1 + BOUND_TOLERANCE
        if beyond.any():
            index = np.argwhere(beyond)[0]
            agent, column = index[-2:]
            raise SchemaError(
                f"column {column} of an action of agent {agent} is {actions[tuple(index)]:g}, "
                f"outside of {self.middle[agent, column]:g} ± {self.half[agent, column]:g}, the "
                "bounds of its space. Record the action that the environment executed, or clip it "
                "first."
            )
        clipped: Float = np.clip(unit, -1, 1).astype(np.float32)
        return clipped

    def to_environment(self, unit: Float) -> Float:
        """Returns numbers [..., N, A] in [-1, 1] as actions of the environment."""
        actions = self.middle + self.half * np.clip(unit.astype(np.float64), -1, 1)
        inside = np.clip(actions, self.middle - self.half, self.middle + self.half)
        narrow: Float = inside.astype(np.float32)
        return narrow


def action_scale(spec: Spec) -> ActionScale:
    """Returns the affine map between the bounds of an environment's actions and [-1, 1].

    Raises:
        SchemaError: an agent's actions are not continuous, or without a bound.
    """
    middle = np.zeros((spec.n_agents, spec.action_size))
    half = np.ones_like(middle)
    for index, (name, space) in enumerate(zip(spec.agent_names, spec.action_spaces, strict=True)):
        if not is_continuous(space):
            raise SchemaError(
                f"actions of {name} in {spec.task} are choices ({space}), expected "
                "continuous ones, which alone can be scaled."
            )
        low, high = bounds(space)
        unbounded = ~(np.isfinite(low) & np.isfinite(high))
        if unbounded.any():
            column = int(np.flatnonzero(unbounded)[0])
            raise SchemaError(
                f"column {column} of the actions of {name} in {spec.task} has the bounds "
                f"{low[column]:g} and {high[column]:g}, expected finite ones: algorithms choose "
                "in [-1, 1]. Wrap the environment so that its action space is bounded, then "
                "record; `transitions()` and episodes have the actions as they are."
            )
        columns = slice(len(low))
        middle[index, columns] = (low + high) / 2
        half[index, columns] = np.where(high > low, (high - low) / 2, 1.0)
    return ActionScale(middle, half)


def has_choices(spec: Spec) -> tuple[str, ...]:
    """Names of the agents whose actions are not continuous."""
    agents = zip(spec.agent_names, spec.action_spaces, strict=True)
    return tuple(name for name, space in agents if not is_continuous(space))


def choices_of(spec: Spec) -> tuple[tuple[range, ...], ...]:
    """Returns the whole numbers that each agent chooses from, by column; empty if none chooses.

    Raises:
        SchemaError: some actions are choices and others are not.
    """
    if spec.action_kind != "choices":
        return ()
    agents = zip(spec.agent_names, spec.action_spaces, strict=True)
    return tuple(_ranges(space, name, spec) for name, space in agents)


def _ranges(space: Space, name: str, spec: Spec) -> tuple[range, ...]:
    match space:
        case DiscreteSpace() | MultiDiscreteSpace() | MultiBinarySpace():
            low, high = bounds(space)
            return tuple(range(int(a), int(b) + 1) for a, b in zip(low, high, strict=True))
        case TupleSpace() | DictSpace():
            return tuple(each for part in parts_of(space) for each in _ranges(part, name, spec))
    raise SchemaError(
        f"actions of {name} in {spec.task} have a continuous part ({space}) beside choices. "
        "Algorithms learn either continuous actions or choices: wrap the environment so that it "
        "has one kind."
    )
