"""CasADi's QP solver qrqp, with enough scratch memory.

In casadi 3.6 to 3.8 the dual line search of qrqp (`casadi_qrqp_dual_breakpoints`) can write one entry beyond an integer
array, which damages the heap. The array is the last in the scratch memory, so `with_spare_room` lengthens that memory.
In generated C, a failed solve ends every function that contains it, unless `going_on_after_failed_solves` edits the
code.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from rehab_opt.symbolic.compiled import going_on_after_failed_solves

__all__ = ["QRQP_ITERATIONS", "going_on_after_failed_solves", "qrqp", "qrqp_options", "with_spare_room"]

QRQP_ITERATIONS = 50
"""Cap on active-set changes, each of up to 13 us; an answer that is not found by then fails its certificate."""
FINITE = 1e30
"""Finite value that replaces an impossible bound."""
SPARE = 2
"""Additional integers of scratch memory; qrqp writes one of them."""


def qrqp(name: str, n: int, m: int, *, iterations: int = QRQP_ITERATIONS) -> ca.Function:
    """Solver of a dense QP with n variables and m rows that generates C; inputs and outputs as `casadi.conic`.

    If the solver fails, the certificate rejects its answer. CasADi would raise an error for NaN or crossing bounds, so
    these are replaced; the certificate rejects the answer to such a QP, too.
    """
    shape = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
    solver = ca.conic(name, "qrqp", shape, qrqp_options(iterations))
    given = dict(zip(solver.name_in(), solver.mx_in(), strict=True))
    seen = dict(given)
    for low, high in (("lba", "uba"), ("lbx", "ubx")):
        seen[low] = ca.fmin(given[low], FINITE)
        seen[high] = ca.fmax(ca.fmax(given[high], -FINITE), seen[low])
    inputs, outputs = list(given.values()), solver.call(list(seen.values()))
    return with_spare_room(ca.Function(name, inputs, outputs, solver.name_in(), solver.name_out()))


def qrqp_options(iterations: int = QRQP_ITERATIONS) -> dict[str, Any]:
    """Options of every qrqp, also inside an NLP solver."""
    quiet = {"print_iter": False, "print_header": False, "print_info": False, "print_lincomb": False}
    return {
        **quiet,
        "error_on_fail": False,
        "max_iter": iterations,
        "constr_viol_tol": 1e-10,
        "dual_inf_tol": 1e-10,
    }


def with_spare_room(function: ca.Function) -> ca.Function:
    """The same function with at least `SPARE` more integers of scratch memory, for a branch that never runs."""
    size = function.sz_iw() + SPARE
    shape = {"h": ca.Sparsity.diag(size), "a": ca.Sparsity(0, size)}
    needy = ca.conic(f"{function.name()}_spare", "qrqp", shape, qrqp_options())
    zero = ca.MX.sym("zero")
    taken = ca.Function("taken", [zero], [zero + needy(h=ca.MX.eye(size))["cost"]])
    passed = ca.Function("passed", [zero], [zero])
    never = ca.Function.if_else(f"{function.name()}_never", taken, passed)

    names_in = [function.name_in(i) for i in range(function.n_in())]
    names_out = [function.name_out(i) for i in range(function.n_out())]
    inputs = [ca.MX.sym(name, function.sparsity_in(i)) for i, name in enumerate(names_in)]
    outputs = list(function.call(inputs))
    first = next(i for i, given in enumerate(inputs) if given.nnz())
    outputs[0] = outputs[0] + never(inputs[first].nz[0] < -1e300, 0)
    return ca.Function(function.name(), inputs, outputs, names_in, names_out)
