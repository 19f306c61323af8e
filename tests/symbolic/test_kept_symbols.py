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
from tests.golden.functions import Met, assert_functions_kept, digest, drawn

WRITTEN = """static const casadi_real casadi_c0[4] = {1.5, -2., 3.0000000000000001e-01};
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
  if (res[0]!=0) res[0][0]=a0;
}
*sz_w = 13;
"""


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


def test_texts_and_records_are_those_kept() -> None:
    (text, table), record, x = with_table(WRITTEN), Record(one=1, two=2, three=3), ca.SX.sym("x", 3)
    changed = record.changed(record.parts(ca.SX([1, 2, 3, 4, 5, 6])), two=ca.SX([9, 8]))
    along = mapped(ca.Function("along", [x], [ca.vertcat(x[0] * x[1], x[2])]))
    numbers = record["one"], record["three"], record.numbers(one=1.0, two=[2, 3], three=4.0), changed.column
    sizes = [(table_size(count), table_step(count)) for count in range(1, 300, 7)]
    total = BufferedFunction(ca.Function("sum", [x], [ca.sum1(x)])).of([1.0, 2.0, 3.0])
    values = along(np.arange(12.0).reshape(4, 3)), total
    kept = {"text": text, "shape": shape_of(WRITTEN), "numbers": digest(np.frombuffer(table), numbers, sizes, values)}
    assert_kept("symbolic", kept)
