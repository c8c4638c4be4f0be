"""Axes with round numbers at their ticks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

MOST_TICKS = 7


@dataclass(frozen=True)
class Axis:
    """Values from `low` to `high`, drawn from `start` to `end`."""

    low: float
    high: float
    step: float
    start: float
    end: float

    def place(self, value: float) -> float:
        """Where a value is drawn."""
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)

    @property
    def ticks(self) -> list[float]:
        """Round values, from the lowest to the highest."""
        n = round((self.high - self.low) / self.step)
        return [self.low + k * self.step for k in range(n + 1)]

    def label(self, value: float, extra: int = 0) -> str:
        """A value with the decimals of the ticks, and `extra` more."""
        decimals = max(0, -math.floor(math.log10(self.step) + 1e-9)) + extra
        text = f"{value:,.{decimals}f}"
        return text.removeprefix("-") if not float(text.replace(",", "")) else text


def nice_axis(values: Sequence[float], start: float, end: float) -> Axis:
    """Returns an axis that holds all values, with round ends.

    Args:
        values: to show; without any, the axis goes from 0 to 1.
        start: where it begins.
        end: where it ends.
    """
    low, high = (min(values), max(values)) if values else (0.0, 1.0)
    span = high - low or abs(high) or 1.0
    power = 10.0 ** math.floor(math.log10(span / MOST_TICKS))
    step = next(k * power for k in (1, 2, 5, 10) if k * power * MOST_TICKS >= span)
    first, last = math.floor(low / step + 1e-9) * step, math.ceil(high / step - 1e-9) * step
    return Axis(first, last if last > first else first + step, step, start, end)
