"""Sequence networks: masks by hand, a twin of NumPy, and memories that equal windows."""

import math
from typing import Any

import numpy as np
import pytest
import torch

from swarmdata.learn.memory.sequence_networks import (
    Mixture,
    SequenceShape,
    StackedSequences,
    decide,
    earlier,
    over_window,
    with_past,
)
from swarmdata.learn.networks.perceptrons import Layer, initialize
from swarmdata.types import Double

K, B, L, N, F, D, H = 2, 3, 5, 4, 6, 2, 2
SHAPE = SequenceShape(inputs=F, told=D, width=8, n_heads=H, outputs=3)


def network() -> StackedSequences:
    made = StackedSequences(SHAPE, K, "cpu")
    initialize(made, range(K), 0)
    return made


LAYERS = [
    Layer(layer.weight.detach().double(), layer.bias.detach().double())
    for layer in network().layers
]


def inputs(seed: int = 0) -> tuple[Any, Any, Any]:
    """Tokens [K, B, L, N, F], what robots were told [K, B, L, N, N, D], and a mask of all."""
    generator = torch.Generator().manual_seed(seed)
    tokens = torch.randn(K, B, L, N, F, generator=generator).double()
    told = torch.randn(K, B, L, N, N, D, generator=generator).double()
    return tokens, told, torch.ones(K, B, L, dtype=torch.bool)


def forward(tokens: Any, told: Any, mask: Any, hears: Any = None) -> Any:
    """Outputs of every step of windows, [K, B, L, N, outputs]."""
    hears = earlier(N, "cpu") if hears is None else hears
    embedded, recalled = (each.flatten(1, 2) for each in over_window(LAYERS, tokens, mask, H))
    known = with_past(LAYERS, embedded, recalled)
    return decide(LAYERS, known, told.flatten(1, 2), hears, H).view(K, B, L, N, -1)


def test_robots_that_hear_nobody_act_alone() -> None:
    tokens, told, mask = inputs()
    deaf = torch.zeros(N, N, dtype=torch.bool)
    before = forward(tokens, told, mask, deaf)
    tokens[..., 0, :] += 1.0
    after = forward(tokens, told + 1.0, mask, deaf)
    assert torch.equal(before[..., 1:, :], after[..., 1:, :])
    assert not torch.isclose(before[..., 0, :], after[..., 0, :]).any(-1).all()


def test_padding_is_not_recalled() -> None:
    tokens, told, mask = inputs()
    mask[:, 0, :2] = False
    before = forward(tokens, told, mask)
    tokens[:, 0, :2] += 7.0
    after = forward(tokens, told, mask)
    assert torch.equal(before[:, :, 2:], after[:, :, 2:])
    alone = forward(tokens[:, :, 2:].repeat(1, 1, 2, 1, 1)[:, :, :L], told, torch.ones_like(mask))
    torch.testing.assert_close(alone[:, 0, : L - 2, 0], after[:, 0, 2:, 0])  # whom nobody tells


def test_the_last_robot_alone_decides_as_among_all() -> None:
    tokens, told, mask = inputs()
    whole = forward(tokens, told, mask)
    known = with_past(
        LAYERS, *(each.flatten(1, 2) for each in over_window(LAYERS, tokens, mask, H))
    )
    for robot in range(N):
        team = slice(robot + 1)
        hears = (torch.arange(robot + 1) < robot)[None]
        heard = told.flatten(1, 2)[:, :, robot : robot + 1, team]
        found = decide(LAYERS, known[:, :, team], heard, hears, H)
        torch.testing.assert_close(found[:, :, 0], whole.flatten(1, 2)[:, :, robot])


def test_the_forward_pass_is_that_of_its_equations_in_numpy() -> None:
    tokens, told, mask = inputs()
    found = forward(tokens, told, mask)
    for row in range(K):
        expected = twin(row, tokens[row, 0].numpy(), told[row, 0].numpy())
        np.testing.assert_allclose(found[row, 0].numpy(), expected, atol=1e-9)


def twin(row: int, x: Double, told: Double) -> Double:
    """The equations of the module, number by number: [L, N, outputs] of [L, N, F]."""
    weights = [layer.weight[row].numpy() for layer in LAYERS]
    biases = [layer.bias[row, 0].numpy() for layer in LAYERS]
    size = SHAPE.width // H

    def linear(place: int, values: Double) -> Double:
        return np.asarray(values @ weights[place] + biases[place])

    def norm(values: Double) -> Double:
        return np.asarray((values - values.mean()) / np.sqrt(values.var() + 1e-5))

    def feed(first: int, h: Double) -> Double:
        return linear(first + 1, np.maximum(linear(first, norm(h)), 0))

    h = np.maximum(linear(0, x), 0)
    q, k, v = np.split(linear(1, h), 3, -1)
    known = np.empty_like(h)
    for t, i in np.ndindex(L, N):
        recalled = []
        for head in range(H):
            at, gamma = slice(head * size, (head + 1) * size), 1 - 0.5 ** (1 + head)
            each = [
                gamma ** (t - s) * (q[t, i, at] @ k[s, i, at]) / math.sqrt(size) * v[s, i, at]
                for s in range(t + 1)
            ]
            recalled.append((1 - gamma) * np.sum(each, axis=0))
        now = h[t, i] + linear(2, np.concatenate(recalled))
        known[t, i] = now + feed(3, now)
    outputs = np.empty((L, N, SHAPE.outputs))
    for t, i in np.ndindex(L, N):
        q_i = linear(5, norm(known[t, i]))[: SHAPE.width]
        heard = np.zeros(SHAPE.width)
        for head in range(H):
            at = slice(head * size, (head + 1) * size)
            scores, values = [], []
            for j in range(i):
                _, k_j, v_j = np.split(linear(5, norm(known[t, j])), 3)
                k_a, v_a = np.split(linear(6, told[t, i, j]), 2)
                scores.append(np.exp(q_i[at] @ (k_j + k_a)[at] / math.sqrt(size)))
                values.append((v_j + v_a)[at])
            if i:
                heard[at] = np.array(scores) @ np.array(values) / (1 + sum(scores))
        now = known[t, i] + linear(7, heard)
        now = now + feed(8, now)
        outputs[t, i] = linear(10, norm(now))
    return outputs


def mixture_of(weights: list[float], means: list[list[float]]) -> Mixture:
    outputs = torch.cat([torch.tensor(weights).log(), torch.tensor(means).atanh().flatten()])
    return Mixture.of(outputs.double(), len(weights))


def test_outputs_are_weights_and_means_of_each_component() -> None:
    mixture = mixture_of([1.0, 3.0], [[0.1, 0.2], [-0.3, 0.4]])
    torch.testing.assert_close(mixture.log_weights.exp(), torch.tensor([0.25, 0.75]).double())
    expected = torch.tensor([[0.1, 0.2], [-0.3, 0.4]]).double()
    torch.testing.assert_close(mixture.means, expected, atol=1e-6, rtol=0)


def test_one_component_is_a_squared_error() -> None:
    outputs, actions = torch.randn(5, 3), torch.rand(5, 2)
    errors = (outputs[:, 1:].tanh() - actions).square().mean(1)
    torch.testing.assert_close(Mixture.of(outputs, 1).surprise(actions, 0.3), errors)


def test_two_components_by_hand() -> None:
    mixture, deviation = mixture_of([0.25, 0.75], [[0.5, 0.0], [-0.5, 0.0]]), 0.5
    action = torch.tensor([0.5, 0.5]).double()
    density = 0.25 * math.exp(-0.25 / 0.5) + 0.75 * math.exp(-1.25 / 0.5)
    expected = -2 * 0.25 / 2 * math.log(density)
    assert mixture.surprise(action, deviation).item() == pytest.approx(expected, abs=1e-6)


def test_the_mode_is_where_the_density_is_largest_not_the_heaviest_component() -> None:
    """Two components share a mode; each of them is lighter than the third, alone at the other."""
    mixture = mixture_of([0.3, 0.3, 0.4], [[0.5, 0.5], [0.52, 0.5], [-0.5, 0.5]])
    assert mixture.mode(0.2)[0] > 0.4
    apart = mixture_of([0.3, 0.2, 0.5], [[0.5, 0.5], [0.0, -0.9], [-0.5, 0.5]])
    torch.testing.assert_close(apart.mode(0.2), apart.means[2])
