"""Time warps of a film: which share of the simulation each share of the film shows [paper 4]."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from .runs import Array, RunError

Warp = Callable[[Array], Array]  #: share of the film, in [0, 1] -> share of the simulation, in [0, 1]

_STEEPNESS = 6.0  # of "explode": its first sixth shows 63 % of the motion

WARPS: dict[str, Warp] = {
    "constant": lambda t: t,
    # Sets in and ends gently, as a balloon is blown up.
    "elastic": lambda t: t * t * (3 - 2 * t),
    # Fastest at first, as an air bag.
    "explode": lambda t: np.expm1(-_STEEPNESS * t) / np.expm1(-_STEEPNESS),
}


_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Pow: operator.pow, ast.USub: operator.neg, ast.UAdd: operator.pos, ast.Lt: operator.lt, ast.LtE: operator.le,
    ast.Gt: operator.gt, ast.GtE: operator.ge,
}  # fmt: skip
_FUNCTIONS = {
    name: getattr(np, name)
    for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "expm1", "log", "log1p", "sqrt", "abs", "where")
} | {"minimum": np.minimum, "maximum": np.maximum}  # fmt: skip
_LONGEST = 500  # letters: each does the work of one operation at most


def evaluate(expression: str, t: Array) -> Any:
    """An expression in t, by doubles alone: nothing in it can take long.

    Raises ValueError, TypeError or SyntaxError where it is none of numbers, t, + - * / ** < <= > >= and functions of numpy.
    """
    if len(expression) > _LONGEST:
        raise ValueError(f"{len(expression)} letters, expected at most {_LONGEST}")

    def value(node: ast.AST) -> Any:
        match node:
            case ast.Constant(value=bool() | complex() | str() | bytes()):
                raise ValueError(f"'{node.value!r}' is no number")
            case ast.Constant(value=(int() | float()) as number):
                return np.float64(number)
            case ast.Name(id="t"):
                return t
            case ast.BinOp(left, op, right) if type(op) in _OPERATORS:
                return _OPERATORS[type(op)](value(left), value(right))
            case ast.UnaryOp(op, operand) if type(op) in _OPERATORS:
                return _OPERATORS[type(op)](value(operand))
            case ast.Compare(left, [op], [right]) if type(op) in _OPERATORS:
                return _OPERATORS[type(op)](value(left), value(right))
            case ast.Call(ast.Name(id=name), arguments, []) if name in _FUNCTIONS:
                return _FUNCTIONS[name](*map(value, arguments))
        raise ValueError(
            f"'{ast.unparse(node)}' is none of numbers, t, + - * / **, comparisons, {', '.join(_FUNCTIONS)}"
        )

    with np.errstate(all="ignore"):
        return value(ast.parse(expression.strip(), mode="eval").body)


def warp_of(name: str, points: list[list[float]] | None = None, expression: str = "") -> Warp:
    """A warp by its name; a custom one interpolates points [[t, w], ...] linearly or is an expression in t.

    Raises RunError for an unknown name, and for a custom warp that falls or does not go from 0 to 1.
    """
    if name in WARPS:
        return WARPS[name]
    if name != "custom":
        raise RunError(f"playback.warp = '{name}', expected one of {', '.join([*WARPS, 'custom'])}")
    if not isinstance(expression, str) or bool(points) == bool(expression):
        raise RunError("playback.warp = 'custom', expected either playback.points or playback.expression")
    if points:
        t, w = np.array(points, dtype=float).T

        def warp(at: Array) -> Array:
            return np.interp(at, t, w)
    else:

        def warp(at: Array) -> Array:
            return np.asarray(evaluate(expression, at), dtype=float)

    samples = np.linspace(0, 1, 1001)
    try:
        values = warp(samples)
    except (SyntaxError, ValueError, TypeError, OverflowError, RecursionError, MemoryError) as error:
        raise RunError(f"playback.expression = '{expression}', expected a function of t: {error}") from None
    if np.shape(values) != samples.shape or not np.isfinite(values).all():
        raise RunError(f"playback.expression = '{expression}', expected a number for every t in [0, 1]")
    if (np.diff(values) < 0).any():
        raise RunError("playback.warp = 'custom' falls, expected one that never goes back")
    if abs(values[0]) > 1e-9 or abs(values[-1] - 1) > 1e-9:
        raise RunError(f"playback.warp = 'custom' goes from {values[0]:g} to {values[-1]:g}, expected 0 to 1")
    return warp
