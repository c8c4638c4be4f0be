"""The policies of K seeds that let robots decide one after another, on what they observed so far.

Every robot is told the actions of the robots before it in the order of their numbers, turned into
its own frame, with the direction of the teller's frame.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.memory.memory_settings import WindowSettings
from swarmdata.learn.memory.segments import learned_rows, learned_steps, take
from swarmdata.learn.memory.sequence_networks import (
    SequenceShape,
    StackedSequences,
    decide,
    earlier,
    over_window,
    with_past,
)
from swarmdata.learn.networks.actor import ACTOR_STREAM
from swarmdata.learn.networks.network_inputs import Standardization, with_agent_id
from swarmdata.learn.networks.perceptrons import initialize
from swarmdata.learn.networks.setup import Setup
from swarmdata.perception.frames import Frame
from swarmdata.types import Batch


@dataclass(frozen=True)
class SequenceSettings(WindowSettings):
    """Settings of policies that act in sequence.

    Raises:
        SchemaError: a size is below 1, or heads do not divide the width.
    """

    window: int = 10  # with 10 steps of burn-in, a robot learns with 10 to 20 steps of its past
    width: int = 64  # of a token
    n_heads: int = 4  # of each attention; the slowest forgets half of a step in 11 steps
    n_components: int = 4  # modes of a robot's action
    deviation: float = 0.2  # of each mode; what is nearer than that is one mode
    joint: bool = True  # whether robots hear those before them; without, each acts alone

    def __post_init__(self) -> None:
        if self.n_heads < 1 or self.width < 1 or self.width % self.n_heads:
            raise SchemaError(
                f"got width={self.width} and n_heads={self.n_heads}, expected a width that is a "
                "multiple of the number of heads"
            )
        if self.n_components < 1 or self.deviation <= 0:
            raise SchemaError(
                f"got n_components={self.n_components} and deviation={self.deviation}, expected at "
                "least 1 and above 0"
            )


class SequenceActor:
    """Maps all observations of an episode so far, and the actions of robots before, to mixtures."""

    def __init__(self, setup: Setup, settings: SequenceSettings) -> None:
        sizes = setup.sizes
        self.shape = SequenceShape(
            inputs=sizes.observation + sizes.n_agents,
            told=sizes.action + (0 if sizes.frame is None else 2),
            width=settings.width,
            n_heads=settings.n_heads,
            outputs=settings.n_components * (1 + sizes.action),
        )
        self.network = StackedSequences(self.shape, setup.n_seeds, setup.device)
        initialize(self.network, setup.seeds, ACTOR_STREAM)
        self.settings, self.sizes = settings, sizes
        self._hears = earlier(sizes.n_agents, setup.device) & settings.joint
        self.standard = Standardization.of(setup.statistics, setup.device)

    def along(self, batch: Batch) -> tuple[Batch, Tensor]:
        """Returns the transitions to learn from, fields [K, R, ...], and the outputs there.

        The batch has windows [K, B, L, ...]; R is B times the steps of a segment.
        """
        layers, n_heads = self.network.layers, self.settings.n_heads
        rows = learned_rows(batch.mask, self.settings.window)
        steps = learned_steps(batch, rows)
        seen = self.standard(batch.observations).masked_fill(~batch.mask[..., None, None], 0.0)
        embedded, recalled = over_window(layers, with_agent_id(seen), batch.mask, n_heads)
        tokens = with_past(layers, take(embedded, rows), take(recalled, rows))
        told = told_actions(self.sizes.frame, steps.observations, steps.actions)
        return steps, decide(layers, tokens, told, self._hears, n_heads)


def told_actions(frame: Frame | None, observations: Tensor, actions: Tensor) -> Tensor:
    """Returns what each robot is told of each action, [..., N, N, D]; tellers are the last but one.

    Observations [..., N, O], not normalized, and actions [..., N, A] are each in the frame of their
    robot; without a frame, in the world's.
    """
    n_agents = actions.shape[-2]
    told = actions[..., None, :, :].expand(*actions.shape[:-2], n_agents, -1, -1)
    if frame is None:
        return told
    axis = observations.shape[-1] - frame.n_added
    ux, uy = observations[..., axis, None], observations[..., axis + 1, None]  # [..., N, 1]
    wx, wy = ux.transpose(-1, -2), uy.transpose(-1, -2)
    cosines, sines = ux * wx + uy * wy, ux * wy - uy * wx  # [..., N, N]
    x, y = told[..., 0], told[..., 1]
    turned = torch.stack([cosines * x - sines * y, sines * x + cosines * y], -1)
    turns = torch.from_numpy(frame.turns(n_agents)).to(told.device)[:, None]  # of the tellers
    told = torch.cat([torch.where(turns, turned, told[..., :2]), told[..., 2:]], -1)
    return torch.cat([told, cosines[..., None], sines[..., None]], -1)
