"""Which cases of a parametrized test the default run has: the others are slow."""

from collections.abc import Sequence
from itertools import combinations, product
from typing import Any

import pytest

Case = tuple[Any, ...]


def slow(*cases: Any) -> list[Any]:
    """Cases of one parameter, for `parametrize`, that repeat what a default case holds."""
    return [pytest.param(case, marks=pytest.mark.slow) for case in cases]


def every(step: int, cases: Sequence[Any]) -> list[Any]:
    """Cases of one parameter, for `parametrize`, of which every `step`-th is fast."""
    return [case if k % step == 0 else slow(case)[0] for k, case in enumerate(cases)]


def pairwise(*choices: Sequence[Any]) -> list[Any]:
    """All cases of a product, for `parametrize`; those that add no pair are slow.

    Args:
        choices: what each parameter may be.
    """
    cases = list(product(*(range(len(each)) for each in choices)))
    return _marked(choices, _covering(cases))


def once_each(*choices: Sequence[Any]) -> list[Any]:
    """All cases of a product, for `parametrize`; those are fast that hold each choice once.

    Args:
        choices: what each parameter may be; the shorter ones begin again.
    """
    longest = max(map(len, choices))
    chosen = {tuple(k % len(each) for each in choices) for k in range(longest)}
    return _marked(choices, chosen)


def _marked(choices: Sequence[Sequence[Any]], chosen: set[Case]) -> list[Any]:
    """All cases of a product, of which those that are not chosen are slow."""
    return [
        pytest.param(
            *(each[k] for each, k in zip(choices, case, strict=True)),
            marks=[] if case in chosen else [pytest.mark.slow],
        )
        for case in product(*(range(len(each)) for each in choices))
    ]


def _covering(cases: Sequence[Case]) -> set[Case]:
    """Cases with all pairs, greedily: at each step one with the most that are still missing."""
    numbers: dict[Any, int] = {}  # of pairs, bits of the integers below
    pairs = {
        case: sum(
            1 << numbers.setdefault(pair, len(numbers)) for pair in combinations(enumerate(case), 2)
        )
        for case in cases
    }
    missing = (1 << len(numbers)) - 1
    chosen: set[Case] = set()
    while missing:
        best = max(cases, key=lambda case: (pairs[case] & missing).bit_count())
        chosen.add(best)
        missing &= ~pairs[best]
    return chosen
