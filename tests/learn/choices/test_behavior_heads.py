"""Behavior heads, and choosing with their help: masks, temperatures, joint choices."""

import math
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from swarmdata.errors import SchemaError
from swarmdata.learn.choices.behavior_heads import (
    Rule,
    behavior_log_probs,
    combinations,
    cross_entropy,
    head_size,
    split,
)
from swarmdata.learn.choices.choices import Choices
from swarmdata.learn.networks.setup import Sizes

KNOTS = Choices.of(Sizes(n_agents=2, observation=1, action=2, state=1), 3)
UNEQUAL = Choices.of(
    Sizes(2, 1, 2, 1, choices=((range(3), range(2)), (range(1, 3),))), 9
)  # robot 0: 3 x 2, robot 1: 2

EQUAL = Choices.of(Sizes(2, 1, 2, 1, choices=((range(3), range(3)),) * 2), 9)


def rule(regulariser: Any, **changes: Any) -> Rule:
    values = {"temperature": 0.5, "threshold": 0.5, "head": "factored", **changes}
    return Rule(regulariser, **values)


def taken(
    rule: Rule,
    utilities: Tensor,
    log_probs: Tensor | None,
    choices: Choices,
    allowed: Tensor | None = None,
) -> Tensor:
    """What is chosen, as whole numbers, of actions that are one choice in every column."""
    weights = rule.act(utilities, log_probs, choices, allowed)
    assert torch.equal(weights.amax(-1), torch.ones(weights.shape[:-1]))
    return weights.argmax(-1)


def log(*probabilities: float) -> Tensor:
    return torch.tensor(probabilities).log()


@pytest.mark.parametrize("head", ["factored", "joint"])
@pytest.mark.parametrize("choices", [KNOTS, UNEQUAL])
def test_heads_are_distributions_over_what_exists(choices: Choices, head: Any) -> None:
    outputs = torch.randn(5, 2, head_size(choices, head))
    log_probs = behavior_log_probs(outputs, choices, head)
    torch.testing.assert_close(log_probs.exp().sum(-1), torch.ones(log_probs.shape[:-1]))
    if choices.exists is None:
        return
    assert head == "joint" or torch.equal(log_probs[0] > -math.inf, choices.exists)
    assert (log_probs[0] > -math.inf).flatten(1).sum(1).tolist() == (
        [3 * 2, 2] if head == "joint" else [3 + 2, 2 + 1]
    )


@pytest.mark.parametrize("head", ["factored", "joint"])
@pytest.mark.parametrize("choices", [KNOTS, UNEQUAL])
def test_the_cross_entropy_is_least_at_the_data(choices: Choices, head: Any) -> None:
    """A head that is trained on one action predicts its weights; nothing becomes NaN."""
    actions = torch.tensor([[[0.5, -1.0], [1.0, 0.0]]]) if choices is KNOTS else (
        torch.tensor([[[2.0, 1.0], [1.0, 0.0]]])
    )  # fmt: skip
    weights = choices.weights(actions)
    outputs = torch.zeros(1, 2, head_size(choices, head), requires_grad=True)
    for _ in range(200):
        log_probs = behavior_log_probs(outputs, choices, head)
        loss = cross_entropy(log_probs, weights, head)
        assert loss.shape == (1, 2)
        (gradient,) = torch.autograd.grad(loss.sum(), outputs)
        assert gradient.isfinite().all()
        outputs = (outputs - gradient).detach().requires_grad_()
    wanted = combinations(weights, torch.mul) if head == "joint" else weights
    torch.testing.assert_close(log_probs.exp(), wanted, atol=0.03, rtol=0)


@settings(deadline=None, max_examples=30)
@given(st.integers(2, 4), st.integers(1, 3), st.integers(0, 99))
def test_combinations_are_split_again(n_choices: int, n_columns: int, seed: int) -> None:
    choices = Choices.of(Sizes(2, 1, n_columns, 1), n_choices)
    values = torch.randn(2, n_columns, n_choices, generator=torch.Generator().manual_seed(seed))
    joined = combinations(values, torch.add)
    numbers = split(torch.arange(choices.n_combinations), choices)  # [C ** D, D]
    for robot in range(2):
        picked = torch.stack([values[robot, d, numbers[:, d]] for d in range(n_columns)]).sum(0)
        torch.testing.assert_close(joined[robot], picked)


def test_bc_weighs_utilities_against_behavior() -> None:
    utilities = torch.tensor([[[0.0, 1.0, 0.0], [3.0, 0.0, 0.0]]])  # one robot
    log_probs = torch.stack([log(0.8, 0.1, 0.1), log(0.1, 0.8, 0.1)])[None]
    choices = Choices.of(Sizes(1, 1, 2, 1, ((range(3), range(3)),)), 3)
    # column 0: 1 / 0.5 < log 8 stays with the data; column 1: 3 / 0.5 > log 8 does not
    assert taken(rule("bc"), utilities, log_probs, choices).tolist() == [[0, 0]]
    assert taken(rule("bc", temperature=0.1), utilities, log_probs, choices).tolist() == [[1, 0]]
    assert taken(rule("bc", temperature=9.0), utilities, log_probs, choices).tolist() == [[0, 1]]
    assert taken(rule("none"), utilities, None, choices).tolist() == [[1, 0]]


@pytest.mark.parametrize("head", ["factored", "joint"])
def test_bc_of_knots_takes_the_mean_of_the_improved_distribution(head: Any) -> None:
    columns = torch.stack([log(0.7, 0.2, 0.1), log(0.2, 0.2, 0.6)])[None]
    log_probs = columns if head == "factored" else combinations(columns, torch.add)
    choices = Choices.of(Sizes(1, 1, 2, 1), 3)
    nothing = torch.zeros(1, 2, 3)
    clone = rule("bc", head=head).act(nothing, log_probs, choices)
    torch.testing.assert_close(choices.to_actions(clone).float(), torch.tensor([[-0.6, 0.4]]))
    assert ((clone > 0).sum(-1) <= 2).all()  # as a recorded action would be weighed
    better = torch.tensor([[[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]])
    moved = choices.to_actions(rule("bc", head=head).act(better, log_probs, choices))
    assert moved[0, 0] > -0.6
    torch.testing.assert_close(moved[0, 1].float(), torch.tensor(0.4))


@settings(deadline=None, max_examples=50)
@given(st.sampled_from(["factored", "joint"]), st.floats(0, 1), st.booleans(), st.integers(0, 999))
def test_bcq_never_takes_what_the_data_do_not_do(
    head: Any, threshold: float, is_unequal: bool, seed: int
) -> None:
    choices = UNEQUAL if is_unequal else KNOTS
    g = torch.Generator().manual_seed(seed)
    utilities = torch.randn(20, 2, *choices.values.shape[1:], generator=g)
    log_probs = behavior_log_probs(
        3 * torch.randn(20, 2, head_size(choices, head), generator=g), choices, head
    )
    chosen = taken(rule("bcq", threshold=threshold, head=head), utilities, log_probs, choices)
    if head == "joint":
        place = sum(
            chosen[..., d] * choices.n_choices ** (choices.n_columns - 1 - d)
            for d in range(choices.n_columns)
        )
        found, least = log_probs.gather(-1, torch.as_tensor(place)[..., None])[..., 0], 2
    else:
        found, least = log_probs.gather(-1, chosen[..., None])[..., 0], 1
    assert (found >= log_probs.amax(-1) + least * math.log(max(threshold, 1e-30)) - 1e-5).all()
    assert (found > -math.inf).all()


def test_a_joint_head_knows_left_and_right_and_not_the_middle() -> None:
    """Data go (-1, 1) or (1, -1); the columns alone also admit (1, 1), which is valued most."""
    choices = Choices.of(Sizes(1, 1, 2, 1), 2)
    utilities = torch.tensor([[[0.0, 1.0], [0.0, 1.0]]])
    columns = log(0.5, 0.5, 0.5, 0.5).view(1, 2, 2)
    pairs = log(0.01, 0.49, 0.49, 0.01).view(1, 4)
    assert taken(rule("bcq"), utilities, columns, choices).tolist() == [[1, 1]]
    together = taken(rule("bcq", head="joint"), utilities, pairs, choices)
    assert together.tolist() in ([[0, 1]], [[1, 0]])


@pytest.mark.parametrize("regulariser", ["none", "bc", "bcq", "cql"])
@pytest.mark.parametrize("head", ["factored", "joint"])
def test_forbidden_choices_are_not_taken(regulariser: Any, head: Any) -> None:
    """Even where the data did nothing else: the best of what is allowed is what counts."""
    ours = rule(regulariser, head=head)
    g = torch.Generator().manual_seed(0)
    utilities = torch.randn(50, 2, 2, 3, generator=g)
    outputs = 9 * torch.randn(50, 2, head_size(KNOTS, head), generator=g)
    log_probs = behavior_log_probs(outputs, KNOTS, head) if ours.has_behavior else None
    allowed = torch.rand(50, 2, 2, 3, generator=g) < 0.4
    allowed[..., 1] |= ~allowed.any(-1)  # something is
    choices = EQUAL if regulariser == "bc" else KNOTS  # the mean of knots may be between them
    chosen = taken(ours, utilities, log_probs, choices, allowed)
    assert allowed.gather(-1, chosen[..., None]).all()


@pytest.mark.parametrize("changes", [{"temperature": 0.0}, {"threshold": 1.1}])
def test_numbers_out_of_range_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(SchemaError, match="temperature above 0 and threshold from 0 to 1"):
        rule("bcq", **changes)
