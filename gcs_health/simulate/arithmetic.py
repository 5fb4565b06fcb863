"""One source for one flight and for many: the same formulas over floats or over columns.

The physics is written once, over values that are floats (one flight, plain Python) or arrays of one
value a flight (a campaign, numpy). Plain operators do for both; what differs is here.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

Value = Any  # float, or (flights,) array: the formulas do not care


@dataclass(frozen=True, slots=True)
class Arithmetic:
    """The functions that floats and columns do not share."""

    sqrt: Callable[[Value], Value]
    sin: Callable[[Value], Value]
    cos: Callable[[Value], Value]
    minimum: Callable[[Value, Value], Value]
    maximum: Callable[[Value, Value], Value]
    clip: Callable[[Value, Value], Value]  # to plus and minus the second
    clip3: Callable[[Value, Value, Value, Value], list[Value]]  # three at once, to plus and minus the last
    within: Callable[[list[Value], Value, Value], list[Value]]  # each at least the second, at most the third
    largest: Callable[[list[Value]], Value]
    bounded: Callable[
        [Value, Value, Value, Value], Value
    ]  # the first, at most the next two, at least the last
    where: Callable[[Value, Value, Value], Value]
    any: Callable[[Value], bool]
    rint: Callable[[Value], Value]


def _clipped(a: float, most: float) -> float:
    return a if -most < a < most else -most if a < 0.0 else most


def _columns_clipped(a: Value, most: Value) -> Value:
    return np.minimum(np.maximum(a, -most), most)


FLOATS = Arithmetic(
    sqrt=math.sqrt,
    sin=math.sin,
    cos=math.cos,
    minimum=lambda a, b: a if a < b else b,
    maximum=lambda a, b: a if a > b else b,
    clip=_clipped,
    clip3=lambda a, b, c, most: (
        [a, b, c]
        if -most < a < most and -most < b < most and -most < c < most
        else [_clipped(value, most) for value in (a, b, c)]
    ),
    within=lambda values, least, most: (
        values
        if least <= min(values) and max(values) <= most
        else [min(max(value, least), most) for value in values]
    ),
    largest=max,
    bounded=lambda a, most, limit, least: (
        a if least < a < most and a < limit else max(min(a, most, limit), least)
    ),
    where=lambda condition, a, b: a if condition else b,
    any=bool,
    rint=round,
)
COLUMNS = Arithmetic(
    sqrt=np.sqrt,
    sin=np.sin,
    cos=np.cos,
    minimum=np.minimum,
    maximum=np.maximum,
    clip=_columns_clipped,
    clip3=lambda a, b, c, most: [_columns_clipped(value, most) for value in (a, b, c)],
    within=lambda values, least, most: [np.minimum(np.maximum(value, least), most) for value in values],
    largest=lambda values: reduce(np.maximum, values),
    bounded=lambda a, most, limit, least: np.maximum(np.minimum(np.minimum(a, most), limit), least),
    where=np.where,
    any=lambda condition: bool(np.any(condition)),
    rint=np.rint,
)
