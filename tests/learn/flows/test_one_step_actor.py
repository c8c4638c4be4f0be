"""One-step actors: what a robot knows of noise and of the past, and what trains its memory."""

from dataclasses import fields, replace
from typing import Any, get_args

import pytest
import torch

from swarmdata.learn.flows.one_step_actor import Noise, OneStepActor
from swarmdata.learn.networks.setup import Setup
from swarmdata.offline_algos.bc_flow import BCFlowConfig
from swarmdata.types import Batch
from tests.offline_algos.toys import SIZES, random_batch, statistics

WINDOW, LENGTH = 3, 8
GRU: dict[str, Any] = {"memory": "gru", "memory_size": 5, "window": WINDOW}


def made(noise: Noise = "team", **memory: Any) -> OneStepActor:
    config = BCFlowConfig(noise=noise, **memory)
    return OneStepActor(Setup(SIZES, (0, 1), statistics()), config, (16,))


def windows() -> Batch:
    """Four windows of each of two seeds, [2, 4, LENGTH, ...], of consecutive steps."""
    batch = random_batch(2, 4 * LENGTH)
    values = {f.name: getattr(batch, f.name) for f in fields(batch)}
    cut = {k: None if v is None else v.view(2, 4, LENGTH, *v.shape[2:]) for k, v in values.items()}
    batch = Batch(**cut)
    batch.next_observations[:, :, :-1] = batch.observations[:, :, 1:]
    return batch


def test_without_a_memory_the_next_step_is_seen_as_this_one() -> None:
    actor, batch = made(), random_batch(2)
    later = replace(batch, observations=batch.next_observations)
    assert torch.equal(actor.see_next(actor.see(batch)), actor.see(later).features)


@pytest.mark.parametrize("noise", get_args(Noise))
@pytest.mark.parametrize("memory", [{}, GRU])
def test_robots_know_others_noise_only_if_it_is_the_teams(
    noise: Noise, memory: dict[str, Any]
) -> None:
    actor, features = made(noise, **memory), torch.zeros(2, 4, 2, 8 if memory else 3)
    z = torch.zeros(2, 4, 2, 2)
    changed = z.clone()
    changed[:, :, 1] = 1.0  # the noise of robot 1
    moved = (actor(features, z) != actor(features, changed)).any(-1)  # [K, B, N]
    assert moved[..., 1].all()
    assert bool(moved[..., 0].any()) == (noise == "team")


def test_segments_are_learned_from_with_a_memory_of_all_steps_before() -> None:
    actor, batch = made(**GRU), windows()
    view = actor.see(batch)
    assert view.features.shape == (2, 4 * WINDOW, 2, 3 + 5)
    kept = batch.observations[:, :, LENGTH - WINDOW :].flatten(1, 2)
    assert torch.equal(view.batch.observations, kept)
    assert torch.equal(view.features[..., :3], kept)  # moments are 0 and 1
    changed = replace(batch, observations=batch.observations.clone())
    changed.observations[:, 1, 0] += 1.0  # the first step of one window
    moved = (actor.see(changed).features != view.features).any(-1).view(2, 4, WINDOW, 2)
    assert moved[:, 1].all()
    assert not moved[:, [0, 2, 3]].any()


def test_what_is_seen_one_step_later_is_what_the_next_step_of_the_window_sees() -> None:
    actor, batch = made(**GRU), windows()
    view = actor.see(batch)
    later, seen = actor.see_next(view), view.features
    assert not later.requires_grad
    assert seen.requires_grad
    now, after = (x.view(2, 4, WINDOW, 2, -1) for x in (seen, later))
    torch.testing.assert_close(after[:, :, :-1], now[:, :, 1:])


def test_a_loss_on_actions_reaches_what_was_remembered() -> None:
    actor, batch = made(**GRU), windows()
    pi = actor(actor.see(batch).features, torch.zeros(2, 4 * WINDOW, 2, 2))
    actor.network.backward(pi.square().sum())
    of_memory = actor.network.layers[1].weight.shape[1:].numel()  # of the recurrent gates
    first = actor.network.layers[0].weight.shape[1:].numel() + 3 * 5
    assert actor.network.gradient[:, first : first + of_memory].abs().sum(1).all()
