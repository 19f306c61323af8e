"""Nearest command to a given command, subject to rows of a QP."""

from __future__ import annotations

import casadi as ca

from rehab_opt.optim.qrqp import qrqp

__all__ = ["LEAVING", "within_rows"]

LEAVING = 10.0
"""[m^2/s^2] Weight of the rate s at which a margin is regained."""


def within_rows(n: int, m: int) -> ca.Function:
    """Function: H, u (n,), slopes, away, upper (m,), least, most (n,) -> x (n,) nearest to u within rows and interval.

    min |x - u|_H^2 + LEAVING (1 - s)^2  s.t. away s - slopes x <= upper, least <= x <= most, 0 <= s <= 1
    """
    shapes = {
        "H": (n, n),
        "u": (n, 1),
        "slopes": (m, n),
        "away": (m, 1),
        "upper": (m, 1),
        "least": (n, 1),
        "most": (n, 1),
    }
    H, u, slopes, away, upper, least, most = given = [ca.MX.sym(name, *shape) for name, shape in shapes.items()]
    found = qrqp("within_rows", n + 1, m)(
        h=ca.densify(ca.diagcat(H, LEAVING)), g=ca.vertcat(-H @ u, -LEAVING), a=ca.horzcat(-slopes, away),
        lba=-ca.inf * ca.DM.ones(m), uba=upper, lbx=ca.vertcat(least, 0), ubx=ca.vertcat(most, 1), x0=ca.vertcat(u, 0),
    )["x"][:n]  # fmt: skip
    found = ca.if_else(ca.sumsqr(found) < ca.inf, found, u)  # NaN fails
    return ca.Function("within_rows", given, [ca.fmin(ca.fmax(found, least), most)])
