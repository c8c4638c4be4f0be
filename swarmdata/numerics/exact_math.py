"""exp, log, tanh, the log of the normal tail and sums, with the same bits on every platform.

Libraries differ in the last bits. Here everything is elementwise `+ - * /`, `rint`, `frexp`,
products with powers of two and comparisons in float64, which IEEE 754 defines to the last bit.
`tests/numerics/test_exact_math.py` measures the errors.
"""

from collections.abc import Iterable

import numpy as np

from swarmdata.types import Bool, Double

LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
"""log 2 in two parts; the product of the first with any exponent of a float64 is exact."""

HALF_LOG_TWO_PI = 0.9189385332046727418
SQRT_HALF = 0.7071067811865475244

# Remez coefficients of FDLIBM 5.3 (Sun Microsystems 1993), files e_exp.c and e_log.c
_EXP_COEFFICIENTS = (
    1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05,
    -1.65339022054652515390e-06, 4.13813679705723846039e-08,
)  # fmt: skip
_LOG_COEFFICIENTS = (
    6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01,
    2.222219843214978396e-01, 1.818357216161805012e-01, 1.531383769920937332e-01,
    1.479819860511658591e-01,
)  # fmt: skip

# Rational Chebyshev approximations of W. J. Cody, "Rational Chebyshev approximations for the error
# function", Mathematics of Computation 23 (1969), 631-637, as in his CALERF (SPECFUN, netlib);
# each polynomial from its highest power down.
_NEAR_RATIO = (
    (1.85777706184603153e-1, 3.16112374387056560e00, 1.13864154151050156e02,
     3.77485237685302021e02, 3.20937758913846947e03),
    (1.0, 2.36012909523441209e01, 2.44024637934444173e02,
     1.28261652607737228e03, 2.84423683343917062e03),
)  # fmt: skip
_MIDDLE_RATIO = (
    (2.15311535474403846e-8, 5.64188496988670089e-1, 8.88314979438837594e0,
     6.61191906371416295e01, 2.98635138197400131e02, 8.81952221241769090e02,
     1.71204761263407058e03, 2.05107837782607147e03, 1.23033935479799725e03),
    (1.0, 1.57449261107098347e01, 1.17693950891312499e02, 5.37181101862009858e02,
     1.62138957456669019e03, 3.29079923573345963e03, 4.36261909014324716e03,
     3.43936767414372164e03, 1.23033935480374942e03),
)  # fmt: skip
_FAR_RATIO = (
    (1.63153871373020978e-2, 3.05326634961232344e-1, 3.60344899949804439e-1,
     1.25781726111229246e-1, 1.60837851487422766e-2, 6.58749161529837803e-4),
    (1.0, 2.56852019228982242e00, 1.87295284992346047e00, 5.27905102951428412e-1,
     6.05183413124413191e-2, 2.33520497626869185e-3),
)  # fmt: skip
_NEAR_END, _MIDDLE_END = 0.46875, 4.0
_ONE_OVER_SQRT_PI = 5.6418958354775628695e-1


def exp(x: Double) -> Double:
    """Returns e to the power of each value: 0 below -745.13, infinity above 709.78, NaN for NaN.

    It is within 2 units in the last place. With k = rint(x / log 2) and r = x - k log 2, exp(r) is
    a quotient of polynomials (FDLIBM e_exp.c), scaled by 2^k in two exact halves, so that a
    subnormal result is rounded once.
    """
    x = np.asarray(x, dtype=np.float64)
    is_plain = np.abs(x) < 746.0
    k = np.rint(np.where(is_plain, x, 0.0) / (LN2_HIGH + LN2_LOW))
    high, low = np.where(is_plain, x, 0.0) - k * LN2_HIGH, k * LN2_LOW
    r = high - low
    c = r - r * r * _polynomial(_EXP_COEFFICIENTS[::-1], r * r)
    value = 1.0 - ((low - (r * c) / (2.0 - c)) - high)
    whole = k.astype(np.int64)
    half = whole >> 1
    with np.errstate(over="ignore", under="ignore"):
        value = value * np.ldexp(1.0, half) * np.ldexp(1.0, whole - half)
    extreme = np.where(np.isnan(x), np.nan, np.where(x > 0.0, np.inf, 0.0))
    return np.where(is_plain, value, extreme)


def log(x: Double) -> Double:
    """Returns the natural logarithm of each value: -infinity for 0, NaN below 0 and for NaN.

    It is within 2 units in the last place. With x = 2^k (1 + f), sqrt(1/2) <= 1 + f < sqrt(2), and
    s = f / (2 + f), log(1 + f) is 2 s + s P(s^2), as FDLIBM e_log.c sums it.
    """
    x = np.asarray(x, dtype=np.float64)
    is_plain = (x > 0.0) & (x < np.inf)
    mantissa, exponent = np.frexp(np.where(is_plain, x, 1.0))
    is_low = mantissa < SQRT_HALF
    f = np.where(is_low, 2.0 * mantissa, mantissa) - 1.0
    k = (exponent - is_low).astype(np.float64)
    s = f / (2.0 + f)
    z = s * s
    half = 0.5 * f * f
    tail = s * (half + z * _polynomial(_LOG_COEFFICIENTS[::-1], z)) + k * LN2_LOW
    value = k * LN2_HIGH - ((half - tail) - f)
    extreme = np.where(x == 0.0, -np.inf, np.where(x > 0.0, x, np.nan))
    return np.where(is_plain, value, extreme)


def log_of_one_plus(x: Double) -> Double:
    """Returns log(1 + x) for each x >= -1, to a relative 1e-15.

    W. Kahan's correction: the rounding of u = 1 + x is divided out of log(u) x / (u - 1) (N. J.
    Higham, "Accuracy and Stability of Numerical Algorithms", 2nd edition, section 1.14.1).
    """
    x = np.asarray(x, dtype=np.float64)
    u = 1.0 + x
    is_lost = u == 1.0
    is_end = (u == 0.0) | (u == np.inf)
    safe = np.where(is_lost | is_end, 2.0, u)
    return np.where(is_lost, x, np.where(is_end, log(u), log(safe) * (x / (safe - 1.0))))


def tanh(x: Double) -> Double:
    """Returns the hyperbolic tangent of each value, (1 - q) / (1 + q) with q = exp(-2 |x|).

    Its error is at most 3e-16: near 0, that is small beside 1, and not beside the value.
    """
    x = np.asarray(x, dtype=np.float64)
    q = exp(-2.0 * np.abs(x))
    return np.copysign((1.0 - q) / (1.0 + q), x)


def log_tail(z: Double) -> Double:
    """Returns log P(n >= z) of a standard normal n, for each z, to a relative 5e-13.

    The result is 0 for -infinity, and -infinity for infinity and where -z^2 / 2 overflows. For
    z >= 0 this is log(erfc(z / sqrt 2) / 2), where erfc(y) exp(y^2) is Cody's approximation, so
    that the exponent is taken exactly; for z < 0 it is log(1 - P(n >= -z)).
    """
    z = np.asarray(z, dtype=np.float64)
    distance = np.abs(z)
    with np.errstate(over="ignore", invalid="ignore"):
        value = log(0.5 * _scaled_complement(distance * SQRT_HALF)) - 0.5 * distance * distance
        is_near = distance * SQRT_HALF <= _NEAR_END
        if is_near.any():  # rare if noise is small; the values elsewhere are not used
            value = np.where(is_near, log(0.5 - 0.5 * _near(z * SQRT_HALF)), value)
    is_lower = (z < 0.0) & ~is_near
    if is_lower.any():
        value = np.where(is_lower, log_of_one_plus(-exp(value)), value)
    return np.where(distance == np.inf, np.where(z < 0.0, 0.0, -np.inf), value)


def _near(y: Double) -> Double:
    """erf(y) for |y| <= 0.46875 (Cody 1969, eq. 1); arbitrary values elsewhere."""
    square = np.minimum(y * y, 1.0)
    return y * _polynomial(_NEAR_RATIO[0], square) / _polynomial(_NEAR_RATIO[1], square)


def _scaled_complement(y: Double) -> Double:
    """exp(y^2) erfc(y) for y > 0.46875 (Cody 1969, eqs. 2 and 3); some positive value below."""
    is_far: Bool = y > _MIDDLE_END
    middle = np.where(is_far, 1.0, y)
    inner = _polynomial(_MIDDLE_RATIO[0], middle) / _polynomial(_MIDDLE_RATIO[1], middle)
    far = np.where(is_far, y, _MIDDLE_END)
    inverse = 1.0 / (far * far)
    quotient = inverse * _polynomial(_FAR_RATIO[0], inverse) / _polynomial(_FAR_RATIO[1], inverse)
    return np.where(is_far, (_ONE_OVER_SQRT_PI - quotient) / far, inner)


def _polynomial(coefficients: tuple[float, ...], x: Double) -> Double:
    """Horner's rule, from the highest power down."""
    value = np.full_like(x, coefficients[0])
    for coefficient in coefficients[1:]:
        value = value * x + coefficient
    return value


def sum_in_order(values: Iterable[float]) -> float:
    """Returns the sum of numbers, rounded after each; the built-in `sum` of Python 3.12 is not."""
    total = 0.0
    for value in values:
        total += value
    return total
