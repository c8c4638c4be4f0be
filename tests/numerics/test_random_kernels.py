"""Compiled counters give the bits of `seeding`."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmdata.numerics.random import STREAMS, derive, normal, normal_table, uniform
from swarmdata.numerics.random_kernels import absorb, to_normal, to_uniform


@settings(deadline=None)
@given(st.integers(0, 2**64 - 1), st.sampled_from(sorted(STREAMS)), st.integers(0, 2**40))
def test_the_same_bits_as_derive(seed: int, stream: str, counter: int) -> None:
    expected = derive(np.uint64(seed), STREAMS[stream], counter)
    first = np.uint64(absorb(np.uint64(seed), STREAMS[stream]))  # numba returns a Python int
    bits = np.uint64(absorb(first, counter))
    assert bits == expected[0]
    assert to_uniform(bits) == uniform(expected)[0]
    assert to_normal(bits, normal_table()) == normal(expected)[0]
