"""Quantities of specs, with bounds that keep every number of a world finite in float32."""

from typing import Annotated, TypeVar

from pydantic import AfterValidator, Field


def _bounded(least: float, most: float) -> object:
    return Field(ge=least, le=most, allow_inf_nan=False)


Length = Annotated[float, _bounded(1e-3, 1e3)]  # m, above 0
Distance = Annotated[float, _bounded(0.0, 1e3)]  # m, may be 0
Coordinate = Annotated[float, _bounded(-1e3, 1e3)]  # m, of either sign
Duration = Annotated[float, _bounded(1e-3, 1e3)]  # s
Lag = Annotated[float, _bounded(0.0, 1e2)]  # s, a time constant that may be 0
Delay = Annotated[int, Field(ge=0, le=100)]  # control steps
Speed = Annotated[float, _bounded(1e-3, 1e2)]  # m/s
Acceleration = Annotated[float, _bounded(1e-3, 1e3)]  # m/s^2
TurnRate = Annotated[float, _bounded(1e-3, 1e2)]  # rad/s
Angle = Annotated[float, _bounded(1e-6, 10.0)]  # rad
Mass = Annotated[float, _bounded(1e-2, 1e4)]  # kg
Friction = Annotated[float, _bounded(0.0, 2.0)]  # coefficient, without unit
Force = Annotated[float, _bounded(1e-3, 1e5)]  # N
Deviation = Annotated[float, _bounded(0.0, 1e3)]  # standard deviation, in the unit of the quantity
Ratio = Annotated[float, _bounded(1e-3, 1e3)]  # of two quantities of one kind, above 0
Weight = Annotated[float, _bounded(0.0, 1e6)]  # of a term of the reward


Number = TypeVar("Number", float, int)


def _in_order(span: tuple[Number, Number]) -> tuple[Number, Number]:
    if span[0] > span[1]:
        raise ValueError(f"{span} begins above its end, expected the smaller first")
    return span


Range = Annotated[tuple[Number, Number], AfterValidator(_in_order)]
"""The smallest and the largest value of a quantity."""

Span = Range[Length]  # m

Count = Annotated[int, Field(ge=1, le=10**12)]  # a count of at least one; `budget` limits it
CountOrNone = Annotated[int, Field(ge=0, le=10**12)]  # a count that may be zero; `budget` limits it
