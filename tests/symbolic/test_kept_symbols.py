"""What functions of marked expressions give, and what becomes of a written one's constants, is what is kept."""

from __future__ import annotations

import casadi as ca
import numpy as np

from rehab_opt.symbolic.buffered import BufferedFunction, mapped
from rehab_opt.symbolic.compiled import table_size, table_step
from rehab_opt.symbolic.constant_table import shape_of, with_table
from rehab_opt.symbolic.matrices import determinant, solver_of, symmetric, upper_triangle
from rehab_opt.symbolic.record import Record
from rehab_opt.symbolic.tick import Stages
from tests.golden import assert_kept
from tests.golden.functions import Met, assert_functions_kept, digest

WRITTEN = """static const casadi_real casadi_c0[4] = {1.5, -2., 3.0000000000000001e-01};
static const casadi_real casadi_c1[2] =
{-1., 7.};
static int casadi_f1(const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w, int mem) {
  casadi_real a0, a1, a2;
  a0=3.;
  a1=arg[0]? arg[0][0] : 0;
  a1=(a0*a1);
  a2=2.5000000000000000e-01;
  a1=(a1+a2);
  a0=a1;
  w1 = 4.;
  w2 = (w1+1.);
  casadi_fill(w+3, 6, -1.);
  casadi_copy(casadi_c0, 4, w+7);
  if (res[0]!=0) res[0][0]=a0;
  return 0;
}
*sz_w = 13;
"""


def staged() -> list[ca.Function]:
    """One tick with values, branches in branches, calls and what is evaluated before the rest."""
    x, y, z = (ca.SX.sym(name, size) for name, size in (("x", 3), ("y", 2), ("z", 4)))
    tick = Stages()
    first, (second, third) = tick.once(ca.sin(x) + y[0]), tick.once((x[0] * y, ca.SX(ca.DM([[1, 0], [0, 2]]))))
    a, b = ca.MX.sym("a", 3), ca.MX.sym("b", 2, 2)
    called = tick.call(ca.Function("called", [a, b], [a * b[0, 1] + ca.sum1(a), b @ b]), first, ca.SX(z).reshape((2, 2)))

    def deeper() -> ca.SX:
        own = tick.once(z[:3] * first - called[0])
        return tick.when(own[0] > z[3], own + x, lambda: tick.once(own * own[1]) - y[1])

    branch = tick.when(first[0] < second[1], deeper, ca.vertcat(first[1], called[1][0, 1], third[1, 1]))
    column, before = tick.precomputed([x, y, z], [branch, second], later=z)
    later, early = tick.precomputed([x, y, z], [branch], later=y)
    whole = tick.function("tick", [x, y, z], [branch, called[1], third @ second])
    rest = tick.function("rest", [x, y, z, column], [branch, second])
    return [whole, before, early, rest, tick.function("plain", [x, y], [first[0] * y])]


def matrices() -> list[ca.Function]:
    square, upper, right = ca.SX.sym("H", 4, 4), ca.SX.sym("triangle", 10), ca.SX.sym("right", 4, 2)
    full = symmetric(upper, 4)
    expressions = {"determinant": determinant(square), "solved": solver_of(full + 3 * ca.SX.eye(4))(right),
                   "triangle": upper_triangle(square + square.T), "full": full}  # fmt: skip
    return [ca.Function(name, [square, upper, right], [ca.densify(each)]) for name, each in expressions.items()]


def test_functions_are_those_kept() -> None:
    met, rng = Met(), np.random.RandomState(0)
    for function in (*staged(), *matrices()):
        sizes = [function.size_in(i) for i in range(function.n_in())]
        met.functions.append((function, [[rng.normal(size=size).squeeze(1) if size[1] == 1 else rng.normal(size=size) for size in sizes] for _ in range(20)]))  # fmt: skip
    assert_functions_kept("symbolic_functions", met)


def test_texts_and_records_are_those_kept() -> None:
    text, table = with_table(WRITTEN)
    record = Record(one=1, two=2, three=3)
    values = record.parts(ca.SX([1, 2, 3, 4, 5, 6]))
    changed = record.changed(values, two=ca.SX([9, 8]))
    x = ca.SX.sym("x", 3)
    along = mapped(ca.Function("along", [x], [ca.vertcat(x[0] * x[1], x[2])]))
    buffered = BufferedFunction(ca.Function("sum", [x], [ca.sum1(x), x.T @ x]))
    kept = {
        "text": text, "shape": shape_of(WRITTEN), "table": np.frombuffer(table),
        "sizes": [table_size(count) for count in range(1, 300, 7)], "steps": [table_step(count) for count in range(1, 300, 7)],
        "record": [record["one"], record["three"], record.size, *digest(record.numbers(one=1.0, two=[2, 3], three=4.0), ca.DM(changed.column), ca.DM(changed.three))],
        "mapped": digest(along(np.arange(12.0).reshape(4, 3)), along(np.arange(3.0).reshape(1, 3)), buffered.of([1.0, 2.0, 3.0]), width=3),
    }  # fmt: skip
    assert_kept("symbolic", kept)
