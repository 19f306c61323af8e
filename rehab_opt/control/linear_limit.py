"""Limits that are linear in the velocities of one tick: rows of the QP, and largest step sizes."""

from __future__ import annotations

from typing import NamedTuple, Self

import casadi as ca

from rehab_opt.optim.rows import Row, within

__all__ = ["LinearLimit", "SymmetricLimit"]

TINY = 1e-12


class LinearLimit(NamedTuple):
    """matrix u <= upper, for the velocities u (n,) of one tick."""

    matrix: ca.SX
    """(k, n); structural zeros for joints without effect cost nothing."""
    upper: ca.SX
    """(k,) upper bounds in the units of the rows; [m/s] for distances."""

    @classmethod
    def of_joints(cls, first: int, n: int, matrix: ca.SX, upper: ca.SX) -> Self:
        """Limit whose `matrix` (k, m) has columns for m of n joints only; the first of them has the index `first`."""
        k, m = matrix.shape
        return cls(ca.horzcat(ca.SX(k, first), matrix, ca.SX(k, n - first - m)), upper)

    @classmethod
    def stacked(cls, *limits: LinearLimit) -> Self:
        """One limit with the rows of all `limits`."""
        return cls(*(ca.vertcat(*column) for column in zip(*limits, strict=True)))

    @property
    def one_sided(self) -> LinearLimit:
        """The same limit with upper bounds only."""
        return self

    @property
    def row_count(self) -> int:
        """Number of rows k."""
        return int(self.upper.numel())

    def rows(self, u: ca.SX) -> list[Row]:
        """Rows of a QP; an empty list if the limit has no rows."""
        return [within(self.matrix @ u, -ca.inf, self.upper)] if self.row_count else []

    def excess(self, u: ca.SX) -> ca.SX:
        """(k,) excess of velocities u over the limit; not positive if u satisfies the limit."""
        return self.matrix @ u - self.upper

    def beyond(self, u: ca.SX) -> LinearLimit:
        """Limit on u + v for velocities v (n,) that satisfy this limit, with a given u (n,)."""
        return self._replace(upper=self.upper + self.matrix @ u)

    def relaxed(self, u: ca.SX) -> LinearLimit:
        """The limit, relaxed so that velocities u (n,) satisfy it."""
        return self._replace(upper=ca.fmax(self.upper, self.matrix @ u))

    def max_step_size(self, way: ca.SX, begin: ca.SX | None = None, slack: float = 0.0) -> ca.SX:
        """Largest step size, at most 1, along `way` (n,) from the velocities `begin` (n,) within the limit.

        Without `begin` the step starts at rest. The step may exceed the limit by `slack`. If `begin` violates the
        limit, the violation must not grow.
        """
        matrix, upper = self.one_sided
        if not self.row_count:
            return ca.SX(1)
        speeds = matrix @ way
        room = upper if begin is None else ca.fmax(upper - matrix @ begin, 0) + slack
        return ca.fmin(1, ca.mmin(ca.if_else(speeds > room, room / ca.fmax(speeds, TINY), 1)))


class SymmetricLimit(LinearLimit):
    """-upper <= matrix u <= upper."""

    @property
    def one_sided(self) -> LinearLimit:
        """As in `LinearLimit`; the result has 2 k rows."""
        return LinearLimit(ca.vertcat(self.matrix, -self.matrix), ca.vertcat(self.upper, self.upper))

    def rows(self, u: ca.SX) -> list[Row]:
        """See `LinearLimit`."""
        return [within(self.matrix @ u, -self.upper, self.upper)] if self.row_count else []

    def excess(self, u: ca.SX) -> ca.SX:
        """See `LinearLimit`."""
        return ca.fabs(self.matrix @ u) - self.upper
