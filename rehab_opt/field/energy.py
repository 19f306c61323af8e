"""The field's energy and force as one expression over its samples: Eqs. (15)-(20), Rossa et al.

Sample j, at x_j, has the energy offset phi_0j, the slope lean_j and the stiffness S_j. With d = x - x_j and the
normalised weights omega_j = exp(log_weight_j - |d|^2 / (2 sigma^2)),

    Phi = sum_j omega_j phi_j,                phi_j = phi_0j + lean_j^T d + 1/2 d^T S_j d
    -grad Phi = -sum_j omega_j (lean_j + S_j d) + 1/sigma^2 sum_j omega_j (phi_j - Phi) d

The largest exponent is subtracted first, so that one weight is always 1; far from every sample the printed Eq. (16) is
0 / 0.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.field.samples import Samples
from rehab_opt.symbolic import BufferedFunction, Compile, PerThread
from rehab_opt.symbolic.compiled import how

__all__ = [
    "Kernel",
    "arranged_samples",
    "energies_and_forces",
    "field_function",
    "field_function_in_blocks",
    "field_kernel",
    "field_table",
    "filled_up",
    "stiffness_at",
]

BLOCK = 10
"""Samples per block in compiled code; blocks take half the time of passes over all samples."""
ABSENT = -1e300
"""Logarithm of the weight of padding samples in a block."""


class Kernel(NamedTuple):
    """Write `point` (2,) [m], call `function.evaluate`, read `energy` (1,) [J] and the elastic `force` (2,) [N].

    The fields are memory views, which take half of numpy's time to write and read.
    """

    point: Any
    energy: Any
    force: Any
    function: BufferedFunction


def field_kernel(samples: Samples, width: float, *, compile: Compile = None) -> PerThread[Kernel]:
    """Evaluator of a field at one point, with buffers per thread."""
    arranged, in_blocks = arranged_samples(samples, compile=compile)
    function = field_function_in_blocks(arranged.shape[1]) if in_blocks else field_function(len(arranged))

    def kernel() -> Kernel:
        owner = BufferedFunction(function, compile=compile)
        point, owner.inputs[1][...], owner.inputs[2][...] = owner.inputs[0], arranged, 1 / width**2
        energy, force = owner.outputs
        return Kernel(point.data, energy.data, force.data, owner)

    return PerThread(kernel)


def energies_and_forces(kernel: Kernel, points: NDArray[np.float64]) -> tuple[Any, Any]:
    """Two results at `points` (N, 2): energy Phi (N,) [J] and force -grad Phi (N, 2) [N]."""
    energies, forces = np.empty(len(points)), np.empty((len(points), 2))
    for i, (x, y) in enumerate(points.tolist()):
        kernel.point[0], kernel.point[1] = x, y
        kernel.function.evaluate()
        energies[i], forces[i] = kernel.energy[0], kernel.force
    return energies, forces


def stiffness_at(samples: Samples, width: float, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2, 2) [N/m] second derivative of Phi at `point` (2,)."""
    size = len(samples.points)
    inputs = [ca.MX.sym("x", 2), ca.MX.sym("samples", size, 8), ca.MX.sym("sharpness")]
    curved = ca.Function("stiffness", inputs, [-ca.jacobian(field_function(size)(*inputs)[1], inputs[0])])
    return np.asarray(curved(point, field_table(samples)[:size], 1 / width**2).full())


def arranged_samples(samples: Samples, *, compile: Compile = None) -> tuple[NDArray[np.float64], bool]:
    """Two results: table of the samples; whether it is for `field_function_in_blocks` or for `field_function`."""
    if how(compile) == "no":  # CasADi's virtual machine is fast with few operations on long columns
        return field_table(samples)[: len(samples.points)], False
    return field_table(samples).T, True


def field_table(samples: Samples) -> NDArray[np.float64]:
    """(size, 8) table of the samples for `field_function`, padded to a multiple of `BLOCK`."""
    points, offsets, stiffness, log_weights, lean = samples
    table = np.column_stack((points, offsets, log_weights, stiffness, lean))
    return filled_up(table, -(-len(table) // BLOCK) * BLOCK)


def field_function(size: int) -> ca.Function:
    """Function (x (2,), samples (size, 8), 1 / sigma^2) -> (energy [J], elastic force (2,) [N]).

    Columns of the samples: x, y [m], phi_0 [J], log weight, diagonal of S [N/m], lean [N].
    """
    x, table, sharpness = ca.MX.sym("x", 2), ca.MX.sym("samples", size, 8), ca.MX.sym("sharpness")
    exponents, energies, away, pull = _terms(x, ca.horzsplit(table), sharpness)
    weights = ca.exp(exponents - ca.mmax(exponents))
    weighted = weights * energies
    sums = [ca.sum1(weights), ca.sum1(weighted)]
    sums += [ca.dot(weighted, each) for each in away] + [ca.dot(weights, each) for each in (*away, *pull)]
    return ca.Function(f"field_{size}", [x, table, sharpness], _answer(sums, sharpness))


def field_function_in_blocks(size: int) -> ca.Function:
    """Same result as `field_function`, for samples (8, size) whose `size` is a multiple of `BLOCK`."""
    x, table, sharpness, largest = ca.SX.sym("x", 2), ca.SX.sym("samples", 8, BLOCK), ca.SX.sym("s"), ca.SX.sym("m")
    exponents, sums = [], ca.SX.zeros(8)
    for sample in ca.horzsplit(table):
        exponent, energy, away, pull = _terms(x, ca.vertsplit(sample), sharpness)
        exponents.append(exponent)
        weight = ca.exp(exponent - largest)
        weighted = weight * energy
        sums += ca.vertcat(weight, weighted, *(weighted * each for each in away), *(weight * e for e in (*away, *pull)))
    best = ca.Function("largest_of_block", [x, table, sharpness], [ca.mmax(ca.vertcat(*exponents))], {"cse": True})
    block = ca.Function("sums_of_block", [x, table, sharpness, largest], [sums], {"cse": True})
    blocks = size // BLOCK
    inputs = [ca.MX.sym("x", 2), ca.MX.sym("samples", 8, size), ca.MX.sym("sharpness")]
    top = ca.mmax(best.map(blocks, [True, False, True], [False])(*inputs))
    whole = block.map(blocks, [True, False, True, True], [True])(*inputs, top)
    return ca.Function(f"field_in_blocks_{size}", inputs, _answer(ca.vertsplit(whole), inputs[-1]))


def _terms(x: Any, sample: list[Any], sharpness: Any) -> tuple[Any, Any, tuple[Any, Any], tuple[Any, Any]]:
    """Exponent of the weight, phi, d, and lean + S d: for one sample, or for columns of samples."""
    at_x, at_y, offset, log_weight, stiff_x, stiff_y, lean_x, lean_y = sample
    away_x, away_y = x[0] - at_x, x[1] - at_y
    half_x, half_y = stiff_x * away_x / 2, stiff_y * away_y / 2
    slope_x, slope_y = lean_x + half_x, lean_y + half_y
    energy = offset + slope_x * away_x + slope_y * away_y
    exponent = log_weight - (sharpness / 2) * (away_x**2 + away_y**2)
    return exponent, energy, (away_x, away_y), (slope_x + half_x, slope_y + half_y)


def _answer(sums: list[Any], sharpness: Any) -> list[Any]:
    """Energy and force from sums over the samples: of omega, and of omega times phi, phi d, d, and lean + S d."""
    total, weighted, energy_x, energy_y, away_x, away_y, pull_x, pull_y = sums
    energy = weighted / total
    force_x = (sharpness * (energy_x - energy * away_x) - pull_x) / total
    force_y = (sharpness * (energy_y - energy * away_y) - pull_y) / total
    return [energy, ca.vertcat(force_x, force_y)]


def filled_up(table: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """The table of samples, extended to (size, 8) by rows whose weight is zero."""
    extra = np.zeros((size - len(table), 8))
    extra[:, 3] = ABSENT
    return np.vstack((table, extra))
