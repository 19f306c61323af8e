"""The field's energy and force as one expression over its samples: Eqs. (15)-(20), Rossa et al."""

from __future__ import annotations

import casadi as ca

__all__ = ["field_function"]


def field_function(size: int) -> ca.Function:
    """From position x (2,), velocity v (2,), samples: energy [J], elastic force (2,) [N], dissipative force (2,) [N].

    Samples: points (2, size) [m], offsets phi_0 (size,) [J], log_weights (size,), stiffness (2, size) [N/m], damping
    (2, size) [N s/m] and the width sigma [m]. With omega_j = exp(log_weight_j - |x - x_j|^2 / (2 sigma^2)) normalised,

        Phi = sum_j omega_j phi_j,                phi_j = phi_0j + 1/2 (x - x_j)' S_j (x - x_j)
        -grad Phi = -sum_j omega_j S_j (x - x_j) + 1/sigma^2 sum_j omega_j (phi_j - Phi) (x - x_j)

    The largest exponent is taken out before the exponential, so that some weight is always one: far from every sample
    Eq. (16) as printed is 0 / 0. A sample of log weight -inf is padding; it must hold finite numbers.
    """
    x, v = ca.MX.sym("x", 2), ca.MX.sym("v", 2)
    points, offsets, log_weights = ca.MX.sym("points", 2, size), ca.MX.sym("offsets", 1, size), ca.MX.sym("w", 1, size)
    stiffness, damping, width = ca.MX.sym("S", 2, size), ca.MX.sym("D", 2, size), ca.MX.sym("width")
    away = ca.repmat(x, 1, size) - points
    square = away[0, :] ** 2 + away[1, :] ** 2
    exponents = log_weights - square / (2 * width**2)
    weights = ca.exp(exponents - ca.mmax(exponents))
    weights = weights / ca.sum2(weights)
    pull = stiffness * away
    energies = offsets + (pull[0, :] * away[0, :] + pull[1, :] * away[1, :]) / 2
    energy = ca.sum2(weights * energies)
    slope = weights * (energies - energy) / width**2
    elastic = away @ slope.T - pull @ weights.T
    dissipative = -(damping @ weights.T) * v
    names = ["x", "v", "points", "offsets", "log_weights", "stiffness", "damping", "width"]
    inputs = [x, v, points, offsets, log_weights, stiffness, damping, width]
    outputs = [energy, elastic, dissipative]
    return ca.Function(f"field_{size}", inputs, outputs, names, ["energy", "elastic", "dissipative"])
