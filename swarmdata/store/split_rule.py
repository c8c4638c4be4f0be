"""The rule by which a recipe or recording splits its episodes into train, validation and test."""

from collections.abc import Sequence

import numpy as np

from swarmdata.errors import SpecError
from swarmdata.numerics.random import STREAMS, derive
from swarmdata.specs.origins import Origin
from swarmdata.specs.recipe import Splits
from swarmdata.store.table import SPLITS
from swarmdata.types import Counts


def assign_splits(origin: Origin, order: Sequence[tuple[int, int]]) -> Counts:
    """Returns the split of each episode, as index into `SPLITS`, [len(order)].

    In each block of `splits.block` consecutive episodes of one policy's stream, random
    positions are validation and test. So splits are stratified by policy, and an episode keeps its
    split when the dataset grows.

    Raises:
        SpecError: the origin has no rule.
    """
    if origin.split_rule is None:
        raise SpecError(f"{origin.id} has no split rule: its episodes keep the splits they had")
    rule, seed = origin.split_rule
    blocks = {(policy, episode // rule.block) for policy, episode in order}
    codes = {key: _block_codes(seed, rule, *key) for key in blocks}
    return np.array([codes[p, e // rule.block][e % rule.block] for p, e in order], dtype=np.uint8)


def empty_validation(n_episodes: int) -> str:
    """Returns what to say of a dataset without validation episodes, and what to do about it."""
    return (
        f"the validation split is empty: none of {n_episodes:,} episodes fell into it. Record more "
        "episodes, or cut logs into shorter ones with `episodes: {length: SECONDS}` in the map."
    )


def _block_codes(seed: int, rule: Splits, policy: int, block: int) -> Counts:
    """Splits of one block: the held-out positions are the head of a Fisher-Yates shuffle."""
    held_out = rule.validation + rule.test
    key = derive(seed, STREAMS["split"], policy, block)
    draws = derive(key, np.arange(held_out, dtype=np.uint64))
    positions = list(range(rule.block))
    for k in range(held_out):
        other = k + int(draws[k]) % (rule.block - k)
        positions[k], positions[other] = positions[other], positions[k]
    codes = np.full(rule.block, SPLITS.index("train"), dtype=np.uint8)
    codes[positions[: rule.validation]] = SPLITS.index("validation")
    codes[positions[rule.validation : held_out]] = SPLITS.index("test")
    return codes
