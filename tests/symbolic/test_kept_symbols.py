"""What functions of marked expressions and of small matrices give is what is kept."""

from __future__ import annotations

import casadi as ca

from rehab_opt.symbolic.matrices import determinant, solver_of, symmetric, upper_triangle
from rehab_opt.symbolic.tick import Stages
from tests.golden.functions import Met, assert_functions_kept, drawn


def staged() -> list[ca.Function]:
    """One tick with values, branches in branches, calls and what is evaluated before the rest."""
    x, y, z = (ca.SX.sym(name, size) for name, size in (("x", 3), ("y", 2), ("z", 4)))
    tick = Stages()
    first, (second, third) = tick.once(ca.sin(x) + y[0]), tick.once((x[0] * y, ca.SX(ca.DM([[1, 0], [0, 2]]))))
    a, b = ca.MX.sym("a", 3), ca.MX.sym("b", 2, 2)
    inner = ca.Function("called", [a, b], [a * b[0, 1] + ca.sum1(a), b @ b])
    called = tick.call(inner, first, ca.reshape(z, 2, 2))

    def deeper() -> ca.SX:
        own = tick.once(z[:3] * first - called[0])
        return tick.when(own[0] > z[3], own + x, lambda: tick.once(own * own[1]) - y[1])

    branch = tick.when(first[0] < second[1], deeper, ca.vertcat(first[1], called[1][0, 1], third[1, 1]))
    column, before = tick.precomputed([x, y, z], [branch, second], later=z)
    rest = tick.function("rest", [x, y, z, column], [branch, second])
    whole = tick.function("tick", [x, y, z], [branch, called[1], third @ second])
    early = tick.precomputed([x, y, z], [branch], later=y)[1]
    return [whole, before, rest, early, tick.function("one", [x, y], [first])]


def matrices() -> ca.Function:
    square, upper, right = ca.SX.sym("H", 4, 4), ca.SX.sym("triangle", 10), ca.SX.sym("right", 4, 2)
    full = symmetric(upper, 4)
    solved = solver_of(full + 3 * ca.SX.eye(4))(right)
    outputs = [determinant(square), solved, upper_triangle(square + square.T), full]
    return ca.Function("matrices", [square, upper, right], [ca.densify(each) for each in outputs])


def test_functions_are_those_kept() -> None:
    met = Met()
    met.functions += [(each, [drawn(each, k) for k in range(20)]) for each in (*staged(), matrices())]
    assert_functions_kept("symbolic_functions", met)
