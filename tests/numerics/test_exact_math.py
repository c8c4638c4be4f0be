"""exp, log and the normal tail against the library's, over dense grids and at the edges."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.numerics.exact_math import (
    HALF_LOG_TWO_PI,
    exp,
    log,
    log_of_one_plus,
    log_tail,
    sum_in_order,
    tanh,
)

REAL = st.floats(allow_nan=False, allow_infinity=False)


def reference_tail(z: float) -> float:
    """log P(n >= z) by the library's erfc, for |z| < 37."""
    if z < -1.0:
        return math.log1p(-math.erfc(-z / math.sqrt(2.0)) / 2.0)
    return math.log(math.erfc(z / math.sqrt(2.0)) / 2.0)


def test_exp_is_within_two_units_in_the_last_place() -> None:
    x = np.linspace(-707.0, 709.7, 40_001)
    expected = np.array([math.exp(value) for value in x])
    assert (np.abs(exp(x) - expected) <= 2.0 * np.spacing(expected)).all()


def test_log_is_within_two_units_in_the_last_place() -> None:
    x = np.concatenate([np.geomspace(5e-324, 1.7e308, 20_001), np.linspace(0.5, 2.0, 20_001)])
    expected = np.array([math.log(value) for value in x])
    assert (np.abs(log(x) - expected) <= 2.0 * np.spacing(np.abs(expected))).all()


def test_log_of_one_plus_is_exact_near_zero() -> None:
    small = np.geomspace(1e-300, 0.99, 10_001)
    x = np.concatenate([small, -small, np.linspace(1.0, 1e6, 1001)])
    expected = np.array([math.log1p(value) for value in x])
    np.testing.assert_allclose(log_of_one_plus(x), expected, rtol=1e-15, atol=0.0)


def test_tanh_is_odd_and_near_the_library() -> None:
    x = np.concatenate([np.linspace(-25.0, 25.0, 40_001), [0.0, 1e-300, 1e3, np.inf, -np.inf]])
    expected = np.array([math.tanh(value) for value in x])
    np.testing.assert_allclose(tanh(x), expected, rtol=0.0, atol=3e-16)
    np.testing.assert_array_equal(tanh(-x), -tanh(x))


def test_log_tail_agrees_with_erfc() -> None:
    z = np.linspace(-37.0, 37.0, 40_001)
    expected = np.array([reference_tail(value) for value in z])
    np.testing.assert_allclose(log_tail(z), expected, rtol=5e-13, atol=0.0)


def test_log_tail_far_out_agrees_with_its_continued_fraction() -> None:
    for z in (10.0, 40.0, 1e3, 1e8):
        fraction = z  # Laplace: tail = density / (z + 1 / (z + 2 / (z + 3 / ...)))
        for k in range(60, 0, -1):
            fraction = z + k / fraction
        expected = -0.5 * z * z - HALF_LOG_TWO_PI - math.log(fraction)
        assert float(log_tail(np.array(z))) == pytest.approx(expected, rel=1e-14)


def test_special_values() -> None:
    inf, nan = math.inf, math.nan
    x = np.array([-inf, inf, nan, 0.0, -0.0, 1.0, -800.0, 800.0])
    np.testing.assert_array_equal(exp(x), [0.0, inf, nan, 1.0, 1.0, exp(np.array(1.0)), 0.0, inf])
    np.testing.assert_array_equal(log(x[:6]), [nan, inf, nan, -inf, -inf, 0.0])
    np.testing.assert_array_equal(
        log(np.array([-1.0, 2.0**-1074])), [nan, log(np.array(2.0**-1074))]
    )
    np.testing.assert_array_equal(log_of_one_plus(np.array([-1.0, 0.0, inf])), [-inf, 0.0, inf])
    tails = log_tail(np.array([-inf, inf, nan, 0.0, -1e200, 1e200]))
    np.testing.assert_array_equal(tails, [0.0, -inf, nan, math.log(0.5), 0.0, -inf])
    assert exp(np.array(-745.1)) == 2.0**-1074


@given(x=REAL)
def test_agrees_with_the_library_anywhere(x: float) -> None:
    if x > 0.0:
        assert float(log(np.array(x))) == pytest.approx(math.log(x), rel=5e-16, abs=0.0)
    if x < 709.0:
        assert float(exp(np.array(x))) == pytest.approx(math.exp(x), rel=5e-16, abs=2.0**-1073)


@given(z=st.lists(st.floats(-40.0, 40.0), min_size=2, max_size=40))
def test_log_tail_falls_and_is_elementwise(z: list[float]) -> None:
    values = np.sort(np.array(z))
    tails = log_tail(values)
    assert (np.diff(tails) <= 1e-12 * np.abs(tails[1:])).all()
    alone = np.concatenate([log_tail(values[k : k + 1]) for k in range(len(values))])
    assert alone.tobytes() == tails.tobytes()


DIGEST = """
import hashlib, numpy as np
from swarmdata.numerics.exact_math import exp, log, log_of_one_plus, log_tail
x = np.linspace(-40.0, 40.0, 10007)
parts = [exp(x), log(np.abs(x) + 1e-9), log_of_one_plus(exp(x)), log_tail(x)]
print(hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest())
"""


def test_bits_do_not_depend_on_the_processor() -> None:
    digests = set()
    for disabled in ("", "AVX2 FMA3 AVX512F AVX512_SKX X86_V3 X86_V4"):
        run = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", DIGEST],
            env={**os.environ, "NPY_DISABLE_CPU_FEATURES": disabled},
            check=True,
            capture_output=True,
            text=True,
        )
        digests.add(run.stdout)
    assert len(digests) == 1


def test_a_sum_is_rounded_after_each_number() -> None:
    """As `sum` did until Python 3.11; a corrected sum of ten tenths is 1."""
    assert sum_in_order([0.1] * 10) == 0.9999999999999999
    assert sum_in_order([]) == 0.0
