"""Whether two solvers differ by more than copies of one of them do: solutions that bifurcate differ by chance, too."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeVar

import numpy as np

from .runs import Array
from .wording import significant

T = TypeVar("T")

LEVEL = 0.05  #: probability of a statement that is false
_MOST = 20_000  # relabellings: of more, so many by chance


@dataclass(frozen=True)
class Spread:
    """Mean distances of pairs of runs, and how often chance alone would set the solvers as far apart."""

    between: float  #: a run of each solver
    first: float  #: two runs of the first solver
    second: float
    probability: float  #: of the energy statistic, if both were one solver; see spread
    least: float  #: the smallest probability that so many runs can give

    @property
    def differ(self) -> bool | None:
        """Whether the solvers differ by more than chance; None: of so few runs nobody can tell."""
        return None if self.least > LEVEL else self.probability <= LEVEL


def spread(first: Sequence[T], second: Sequence[T], distance: Callable[[T, T], float]) -> Spread:
    """Compares two solvers by runs of jittered copies of one body.

    first, second: what is compared of each run, two at least; distance: of two runs, symmetric, in any unit. Twice the mean
    distance between solvers less the means within each is the energy statistic [Szekely & Rizzo 2004]. Its probability is the
    share of all ways to deal the runs out to two solvers that give as large a value. Raises ValueError for a single run.
    """
    n, m = len(first), len(second)
    if min(n, m) < 2:
        raise ValueError(f"{n} and {m} runs, expected two of each solver at least")
    runs = [*first, *second]
    matrix = np.zeros((n + m, n + m))
    for i, j in combinations(range(n + m), 2):
        matrix[i, j] = matrix[j, i] = distance(runs[i], runs[j])
    dealt = _deals(n, m)
    values = _statistic(matrix, dealt)
    # The last is the deal that there is; those that equal it by symmetry count, whatever rounding does.
    is_as_large = values >= values[-1] - 1e-12 * np.abs(values).max()
    n_least = 2 if n == m else 1  # solvers of as many runs may change their names
    return Spread(
        float(matrix[:n, n:].mean()),
        float(matrix[:n, :n].sum() / (n * (n - 1))),
        float(matrix[n:, n:].sum() / (m * (m - 1))),
        float(is_as_large.mean()),
        n_least / math.comb(n + m, n),
    )


def _deals(n: int, m: int) -> Array:
    """Rows of booleans: which runs are the first solver's; all ways or many by chance, the actual one last."""
    actual = np.arange(n + m) < n
    if math.comb(n + m, n) <= _MOST:
        chosen = np.array(list(combinations(range(n + m), n)))[::-1]  # in which the actual one comes first
        dealt = np.zeros((len(chosen), n + m), dtype=bool)
        np.put_along_axis(dealt, chosen, True, axis=1)
        return dealt
    random = np.random.default_rng(0)
    return np.vstack([random.permuted(np.tile(actual, (_MOST, 1)), axis=1), actual])


def _statistic(matrix: Array, dealt: Array) -> Array:
    """Of each deal, the energy statistic."""
    a, b = dealt.astype(float), (~dealt).astype(float)
    n, m = a.sum(axis=1), b.sum(axis=1)
    between, first, second = (((x @ matrix) * y).sum(axis=1) for x, y in ((a, b), (a, a), (b, b)))
    return 2 * between / (n * m) - first / n**2 - second / m**2


def statement(found: Spread, first: str, second: str, unit: str) -> str:
    """One sentence on two solvers by name; unit: of the distances."""
    far, near, other = (significant(value, 2) for value in (found.between, found.first, found.second))
    means = (
        f"runs of {first} and {second} are {far} {unit} apart in the mean, two of {first} {near} {unit} and two of {second} "
        f"{other} {unit}"
    )
    if found.differ is None:
        return f"{means[0].upper()}{means[1:]}: too few to tell a difference from chance."
    chance = f"chance does as much in {significant(100 * found.probability, 2)} % of cases"
    verdict = "the solvers differ" if found.differ else "no difference is shown"
    return f"{means[0].upper()}{means[1:]}: {verdict}, as {chance}."
