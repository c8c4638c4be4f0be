"""Which episodes a dataset takes from its policies' streams, and in which order."""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

from swarmdata.errors import SchemaError
from swarmdata.specs.recipe import Recipe
from swarmdata.types import Int


class MergeOrder(NamedTuple):
    """The episodes of a dataset in order, up to where the given lengths end."""

    order: tuple[tuple[int, int], ...]  # (policy index, index in that policy's stream)
    lacking: int | None  # policy whose next episode is needed and not there; None: it is complete


def merge_order(recipe: Recipe, lengths: Sequence[Sequence[int] | Int]) -> MergeOrder:
    """Merges streams of episodes of these lengths until the recipe's steps are reached.

    The next episode is that of the policy that lags most behind its share of the steps so far, in
    exact rationals; ties go to the lowest index.

    Raises:
        SchemaError: not one sequence per policy, or an episode without steps.
    """
    streams = [[int(length) for length in stream] for stream in lengths]
    if len(streams) != len(recipe.policies) or any(n < 1 for stream in streams for n in stream):
        raise SchemaError(
            f"merge_order got {len(streams)} streams of lengths, expected {len(recipe.policies)} "
            f"(one per policy of {recipe.id}), every length at least 1"
        )
    weights = _weights(recipe)
    whole = sum(weights)
    taken, steps, total = [0] * len(weights), [0] * len(weights), 0
    order: list[tuple[int, int]] = []
    while total < recipe.n_steps:
        lags = [w * total - n * whole for w, n in zip(weights, steps, strict=True)]
        policy = lags.index(max(lags))
        episode = taken[policy]
        if episode == len(streams[policy]):
            return MergeOrder(tuple(order), policy)
        order.append((policy, episode))
        taken[policy] += 1
        steps[policy] += streams[policy][episode]
        total += streams[policy][episode]
    return MergeOrder(tuple(order), None)


def _weights(recipe: Recipe) -> list[int]:
    """The shares as integers in the same exact ratio."""
    shares = [Fraction(policy.share) for policy in recipe.policies]
    common = math.lcm(*(share.denominator for share in shares))
    return [int(share * common) for share in shares]
