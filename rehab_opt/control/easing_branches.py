"""`Easing` as functions with branches: what is needed in one tick of a hundred costs nothing in the others."""

from __future__ import annotations

import casadi as ca

from rehab_opt.control.easing import Easing
from rehab_opt.kinematics.mobile_arm import CHAIR

__all__ = ["eased_and_unhindered", "where_the_way_begins"]


def where_the_way_begins(told: ca.SX, memory: ca.SX, easing: Easing) -> ca.Function:
    """The room's columns in `told`, memory, which begins with the last command -> (n,) `Easing.slower` or that."""
    n = easing.robot.chain.n
    inputs, last = [told, memory], memory[:n]
    keeps = ca.Function("keeps", inputs, [easing.keeps(last)], {"cse": True})
    slower = ca.Function("slower", inputs, [ca.densify(easing.slower(last))], {"cse": True})
    same = ca.Function("same", inputs, [last])
    given = [ca.MX.sym("given", each.numel()) for each in inputs]
    begin = ca.Function.if_else("begin", same, slower)(keeps(*given), *given)
    return ca.Function("where_the_way_begins", given, [begin])


def eased_and_unhindered(full: ca.SX, memory: ca.SX, x: ca.SX, easing: Easing, wanted: ca.SX) -> ca.Function:
    """Complete parameters, q first, memory, x -> (n + 1,) `Easing.eased`, then the share that `unhindered` leaves.

    `wanted` (n,) is an expression of them. The arm's true way is looked at only where a keep-out is near.
    """
    n = easing.robot.chain.n
    eased, step, q = easing.eased(memory[:n], wanted), ca.SX.sym("step", n), ca.SX.sym("q", n)
    first = ca.Function("eased", [full, memory, x], [ca.densify(eased), easing.clear(eased[CHAIR:])], {"cse": True})
    share = easing.unhindered(step[CHAIR:], q[CHAIR:]) if easing.robot.keep_out else ca.SX(1)
    sought = ca.Function("sought", [step, q], [share], {"cse": True})
    all_of_it = ca.Function("all_of_it", [step, q], [ca.SX(1)])
    given = [ca.MX.sym("given", each.numel()) for each in (full, memory, x)]
    command, clear = first.call(given)
    left = ca.Function.if_else("unhindered", all_of_it, sought)(clear, command, given[0][:n])
    return ca.Function("settle", given, [ca.vertcat(command, left)])
