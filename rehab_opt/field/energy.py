"""The field's energy and force as one expression over its samples: Eqs. (15)-(20), Rossa et al."""

from __future__ import annotations

import casadi as ca

__all__ = ["field_function"]


def field_function(size: int) -> ca.Function:
    """From position x (2,) and samples: energy [J] and elastic force (2,) [N].

    Samples: points (size, 2) [m], offsets phi_0 (size,) [J], log_weights (size,), stiffness (size, 2) [N/m],
    lean (size, 2) [N] and 1 / sigma^2 [1/m^2]. With omega_j = exp(log_weight_j - |x - x_j|^2 / (2 sigma^2)), normalised,

        Phi = sum_j omega_j phi_j,                phi_j = phi_0j + (lean_j + 1/2 S_j (x - x_j))' (x - x_j)
        -grad Phi = -sum_j omega_j (lean_j + S_j (x - x_j)) + 1/sigma^2 sum_j omega_j (phi_j - Phi) (x - x_j)

    The largest exponent is taken out before the exponential, so that some weight is always one: far from every sample
    Eq. (16) as printed is 0 / 0.
    """
    x = ca.MX.sym("x", 2)
    points, offsets, log_weights = ca.MX.sym("points", size, 2), ca.MX.sym("offsets", size), ca.MX.sym("w", size)
    stiffness, lean, sharpness = ca.MX.sym("S", size, 2), ca.MX.sym("lean", size, 2), ca.MX.sym("sharpness")
    away_x, away_y = x[0] - points[:, 0], x[1] - points[:, 1]
    exponents = log_weights - (sharpness / 2) * (away_x**2 + away_y**2)
    weights = ca.exp(exponents - ca.mmax(exponents))
    weights = weights / ca.sum1(weights)
    pull_x, pull_y = stiffness[:, 0] * away_x, stiffness[:, 1] * away_y
    energies = offsets + (lean[:, 0] + pull_x / 2) * away_x + (lean[:, 1] + pull_y / 2) * away_y
    energy = ca.dot(weights, energies)
    slope = sharpness * weights * (energies - energy)
    force_x = ca.dot(slope, away_x) - ca.dot(weights, lean[:, 0] + pull_x)
    force_y = ca.dot(slope, away_y) - ca.dot(weights, lean[:, 1] + pull_y)
    names = ["x", "points", "offsets", "log_weights", "stiffness", "lean", "sharpness"]
    inputs = [x, points, offsets, log_weights, stiffness, lean, sharpness]
    return ca.Function(f"field_{size}", inputs, [energy, ca.vertcat(force_x, force_y)], names, ["energy", "elastic"])
