"""Move the constants of CasADi's C code to a table: one library serves all functions that differ only in numbers.

CasADi writes limits, lengths, gains and time steps as literals, and equal literals share a variable, so the C text
depends on their values. Here each use of a constant reads its own table entry. Two controllers of one structure then
have the same text, unless a constant is 0, 1 or 2, for which CasADi writes another operation.
"""

from __future__ import annotations

import re
from array import array

__all__ = ["SETTER", "shape_of", "with_table"]

LITERAL = re.compile(r"-?\d+\.\d*(?:e[+-]\d+)?")
ASSIGNMENT = re.compile(r"  ([aw]\d+) ?= ?(.*);")
DECLARATION = re.compile(r"  casadi_real a\d+(?:, a\d+)*;")
VARIABLE = re.compile(r"\ba\d+\b")
FILLED = re.compile(r"(?m)(?<=^  casadi_fill\()([^;]*, )(-?\d+\.\d*(?:e[+-]\d+)?)(?=\);$)")
ARRAY = re.compile(r"static const casadi_real (casadi_c\d+)\[(\d+)\] =\s*\{([^c}]*)\};")
CONSTANT = re.compile("\0([^\0]*)\0")
WORKSPACE = re.compile(r"(?<=\*sz_w = )\d+|(?<=\bw\+)\d+")
SETTER = "rehab_constants"
"""Name of the library's function that receives the table (N,)."""
AROUND = f"""static double {SETTER}_table[%(count)d];
%(code)s
static const casadi_int {SETTER}_size[3] = {{%(count)d, 1, 1}};
CASADI_SYMBOL_EXPORT int {SETTER}(const double** arg, double** res, casadi_int* iw, double* w, int mem) {{
  int i;
  for (i = 0; i < %(count)d; ++i) {SETTER}_table[i] = arg[0][i];
  return 0;
}}
CASADI_SYMBOL_EXPORT casadi_int {SETTER}_n_in(void) {{ return 1; }}
CASADI_SYMBOL_EXPORT casadi_int {SETTER}_n_out(void) {{ return 0; }}
CASADI_SYMBOL_EXPORT const casadi_int* {SETTER}_sparsity_in(casadi_int i) {{ return {SETTER}_size; }}
"""


def with_table(code: str) -> tuple[str, bytes]:
    """Two results: C code that reads its constants from a table, and the table as doubles of this machine.

    `code` comes from `casadi.CodeGenerator` with `verbose` false. Solvers in the code keep their own constants.
    """
    lines: list[str] = []
    now: dict[str, str] = {}

    def current(match: re.Match[str]) -> str:
        return now[match[0]]

    for line in code.split("\n"):
        start = line[:3]
        if start in {"  a", "  w"} and (found := ASSIGNMENT.fullmatch(line)):
            variable, value = found.groups()
            constant = f"\0{value}\0" if LITERAL.fullmatch(value) else ""
            if variable[0] == "w":
                lines.append(f"  {variable} = {constant or value};")
            elif constant:
                now[variable] = constant
            else:
                value = VARIABLE.sub(current, value)
                now[variable] = f"a{len(lines)}"
                lines.append(f"  const casadi_real a{len(lines)}={value};")
        elif line.startswith("  if (res["):
            lines.append(VARIABLE.sub(current, line))
        elif start != "  c" or not DECLARATION.fullmatch(line):
            lines.append(line)
    table = array("d")

    def entry(match: re.Match[str]) -> str:
        table.append(float(match[1]))
        return f"{SETTER}_table[{len(table) - 1}]"

    def named(match: re.Match[str]) -> str:
        name, size, values = match.groups()
        first, given = len(table), [float(each) for each in values.split(",")]
        table.extend(given + [0.0] * (int(size) - len(given)))
        return f"#undef {name}\n#define {name} ({SETTER}_table + {first})"

    written = FILLED.sub("\\1\0\\2\0", "\n".join(lines))
    written = ARRAY.sub(named, CONSTANT.sub(entry, written))
    table.append(0.0)  # C has no empty arrays
    return AROUND % {"count": len(table), "code": written}, table.tobytes()


def shape_of(code: str) -> str:
    """Code without the sizes of scratch memory, which depend on the number of constants."""
    return WORKSPACE.sub("", code)
