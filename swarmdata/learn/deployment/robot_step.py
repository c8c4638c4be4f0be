"""RobotStep: what one robot computes of its own observation, as a function of tensors alone.

Policies answer for all robots of a team; here each slot of the team gets the same observation, and
the slot of the robot counts.
"""

from abc import ABC
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from swarmdata.errors import ConversionError, PolicyFitError
from swarmdata.interfaces import Policy
from swarmdata.learn.choices.bins import to_actions
from swarmdata.learn.memory.gated_networks import next_memory, read
from swarmdata.learn.networks.network_inputs import standardize
from swarmdata.learn.networks.team_networks import answer, by_network, from_rows, to_rows
from swarmdata.learn.policies.choice_policy import BinPolicy, ChoicePolicy
from swarmdata.learn.policies.recurrent_policy import RecurrentPolicy
from swarmdata.learn.policies.sequence_policy import SequencePolicy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.perception.frames import HEARING_RANGE, NO_HEADING, NOT_SENT, Frame

Portable = TorchPolicy | BinPolicy | ChoicePolicy | RecurrentPolicy
"""Policies that can be exported."""


class RobotStep(nn.Module, ABC):
    """One step of B robots with the policy of one seed.

    Attributes:
        n_robots: robots of the team, N.
        n_features: features of an observation, O.
        memory: numbers that a robot remembers, M; 0 without a memory.
    """

    def __init__(self, policy: Portable, n_robots: int) -> None:
        super().__init__()
        self._frame = policy.frame
        self._mean, self._std = policy.observation_mean, policy.observation_std
        added = 0 if policy.frame is None else policy.frame.n_added
        self.n_robots, self.n_features, self.memory = n_robots, len(self._mean) - added, 0

    def inputs(self, n_rows: int) -> dict[str, Tensor]:
        """Returns inputs of B = `n_rows` robots, by name, to trace the step with."""
        observation = torch.zeros(n_rows, self.n_features)
        found = {"observation": observation, "robot": torch.zeros(n_rows).long()}
        return found | ({"memory": torch.zeros(n_rows, self.memory)} if self.memory else {})

    def features(self, observation: Tensor, robot: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Returns normalized inputs of every slot, [B, N, F], and the frame's x axis, two [B]."""
        values = observation.double()
        ux, uy = torch.ones_like(values[:, 0]), torch.zeros_like(values[:, 0])
        if self._frame is not None:
            ux, uy = directions(self._frame, values, robot)
            values = framed(self._frame, values, ux, uy)
        normal = standardize(values.float().double(), self._mean, self._std)
        return normal[:, None].expand(-1, self.n_robots, -1), ux, uy

    def in_world(self, actions: Tensor, robot: Tensor, ux: Tensor, uy: Tensor) -> Tensor:
        """Returns the action of the robot's slot in the world's frame, float32 [B, A]."""
        rows = robot[:, None, None].expand(-1, 1, actions.shape[-1])
        local = actions.gather(1, rows)[:, 0]
        frame = self._frame
        if frame is None or (frame.heading != NO_HEADING and not frame.holonomic):
            return local.float()
        x, y = local[:, 0], local[:, 1]
        x, y = ux * x - uy * y, uy * x + ux * y
        norm = torch.sqrt(x * x + y * y).clamp(min=1.0)
        turned = torch.cat([(x / norm)[:, None], (y / norm)[:, None], local[:, 2:]], -1)
        turned = turned.clamp(-1.0, 1.0)
        if frame.holonomic:
            turned = torch.where(_is_holonomic(frame, robot)[:, None], turned, local)
        return turned.float()


class DirectStep(RobotStep):
    """A step of a policy without memory: observation [B, O] and robot [B] to action [B, A]."""

    def __init__(self, policy: TorchPolicy | BinPolicy | ChoicePolicy, n_robots: int) -> None:
        super().__init__(policy, n_robots)
        self._policy = policy

    def forward(self, observation: Tensor, robot: Tensor) -> Tensor:
        features, ux, uy = self.features(observation, robot)
        return self.in_world(self.team_actions(features), robot, ux, uy)

    def team_actions(self, features: Tensor) -> Tensor:
        """Returns actions in the frame, float64 [B, N, A]."""
        policy = self._policy
        if isinstance(policy, TorchPolicy):
            outputs = answer(policy.layers, features, policy.parameters)
            return outputs.tanh() if policy.squash else outputs.clamp(-1.0, 1.0)
        if isinstance(policy, BinPolicy):
            return to_actions(policy.best(features), policy.n_bins, torch.float64)
        return policy.choices.to_actions(policy.preferred(features))


class RememberingStep(RobotStep):
    """A step of `RecurrentPolicy`: observation, robot and memory [B, M] to action and memory."""

    def __init__(self, policy: RecurrentPolicy, n_robots: int) -> None:
        super().__init__(policy, n_robots)
        self._policy, self.memory = policy, policy.layers[1].weight.shape[1]

    def forward(self, observation: Tensor, robot: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        layers, parameters = self._policy.layers, self._policy.parameters
        features, ux, uy = self.features(observation, robot)
        before = memory.double()[:, None].expand(-1, self.n_robots, -1)
        rows = to_rows(features[None], parameters)
        after = next_memory(layers, rows, by_network(before[None], parameters))
        shape = (1, *features.shape)
        kept = from_rows(after, shape, parameters)[0].float()
        heard = by_network(kept.double()[None], parameters)
        outputs = from_rows(read(layers, rows, heard), shape, parameters)[0]
        actions = outputs.tanh() if self._policy.squash else outputs.clamp(-1.0, 1.0)
        own = kept.gather(1, robot[:, None, None].expand(-1, 1, kept.shape[-1]))[:, 0]
        return self.in_world(actions, robot, ux, uy), own


def robot_step(policy: Policy, n_robots: int) -> RobotStep:
    """Returns the step of one robot; PolicyFitError if policies of this kind cannot be exported."""
    match policy:
        case TorchPolicy() | BinPolicy() | ChoicePolicy():
            return DirectStep(policy, n_robots)
        case RecurrentPolicy():
            return RememberingStep(policy, n_robots)
        case SequencePolicy(joint=True):
            raise PolicyFitError(
                "a SequencePolicy (oryx) acts for the whole team: each robot needs what those "
                "before it have just chosen, which no file of one robot gets. Export a policy "
                "whose robots act alone, such as one of bc or iql"
            )
    raise PolicyFitError(
        f"policies of class {type(policy).__name__} cannot be exported, expected those of actors "
        "(bc, iql, maddpg_bc, mappo, ...), with gated units or without, or of vdn and qmix"
    )


def fitting_step(policy: Policy, path: Path, features: Sequence[Sequence[str]]) -> RobotStep:
    """Returns the step of one robot, for a new file.

    `features` are the names of what each robot observes, [N] with at most O each.

    Raises:
        PolicyFitError: policies of this kind cannot be exported.
    """
    step, n_features = robot_step(policy, len(features)), max(map(len, features))
    if step.n_features != n_features:
        raise ConversionError(
            f"the policy observes {step.n_features} features, got names of {n_features}. "
            "Export it for the observation model that it was trained on."
        )
    if path.exists():
        raise ConversionError(f"{path} exists already. Choose another path, or move it away.")
    return step


def description(
    step: RobotStep,
    robots: Sequence[str],
    features: Sequence[Sequence[str]],
    about: Mapping[str, Any],
) -> dict[str, Any]:
    """Returns what a file says of its policy, JSON; arguments as of `export_onnx`."""
    named = {name: list(each) for name, each in zip(robots, features, strict=True)}
    return {**about, "robots": list(robots), "features": named, "memory": step.memory}


def _is_holonomic(frame: Frame, robot: Tensor) -> Tensor:
    """Whether each of these robots of a mixed team, [B], is holonomic."""
    return torch.stack([(robot == i).double() for i in frame.holonomic], 1).sum(1) > 0.0


def directions(frame: Frame, observation: Tensor, robot: Tensor) -> tuple[Tensor, Tensor]:
    """`Frame.directions` of observations [B, O] of robots [B]."""
    x, y = observation[:, frame.anchor], observation[:, frame.anchor + 1]
    if frame.holonomic:
        hx, hy = observation[:, frame.heading], observation[:, frame.heading + 1]
        is_holonomic = _is_holonomic(frame, robot)
        x, y = torch.where(is_holonomic, x, hx), torch.where(is_holonomic, y, hy)
    length = torch.sqrt(x * x + y * y)
    is_zero = length == 0.0
    length = torch.where(is_zero, torch.ones_like(length), length)
    return torch.where(is_zero, torch.ones_like(x), x / length), y / length


def framed(frame: Frame, observation: Tensor, ux: Tensor, uy: Tensor) -> Tensor:
    """`Frame.inputs` of observations [B, O], given the frame's x axis."""
    columns = list(observation.unbind(1))
    added = [ux, uy]
    for near, speed in frame.closing:
        added.append(columns[near] * columns[speed] + columns[near + 1] * columns[speed + 1])
    for heard in frame.heard:
        x, y, speed_of = _approach(columns, heard)
        added += [ux * x + uy * y, ux * y - uy * x, speed_of]
    turned = dict(enumerate(columns))
    for k in frame.vectors:
        x, y = columns[k], columns[k + 1]
        turned[k], turned[k + 1] = ux * x + uy * y, ux * y - uy * x
    return torch.stack([*turned.values(), *added], 1)


def _approach(columns: list[Tensor], heard: tuple[int, int, int]) -> tuple[Tensor, Tensor, Tensor]:
    """Nearness times direction of a sender, x and y, and the closing speed, each [B]."""
    position, own, other = heard
    x, y = columns[position], columns[position + 1]
    distance = torch.sqrt(x * x + y * y)
    is_near = (distance > 0.0) & (distance < HEARING_RANGE)
    safe = torch.where(is_near, distance, torch.ones_like(distance))
    scale = torch.where(is_near, (1.0 - distance / HEARING_RANGE) / safe, torch.zeros_like(safe))
    x, y = x * scale, y * scale
    vx, vy = columns[own], columns[own + 1]
    if other != NOT_SENT:
        vx, vy = vx - columns[other], vy - columns[other + 1]
    return x, y, x * vx + y * vy
