"""C code of CasADi functions with only static names, for inclusion in our files."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import casadi as ca

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.qrqp import going_on_after_failed_solves

__all__ = ["Generated", "generated", "renamed"]

OLD_C = "#if __STDC_VERSION__ < 199901L"
"""Line that precedes CasADi's own minimum, maximum and absolute value."""
COMPARISONS = "#if 1 /* comparisons, as in the code that Python runs: it is compiled as gnu89 (symbolic/compiled.py) */"
DEFINITION = re.compile(r"^(?=(?:casadi_real|casadi_int|void|int) casadi_\w+\()", re.MULTILINE)
"""Start of a function of CasADi's runtime; by default the linker sees these functions."""

COPY, FROM_WORK = "void casadi_copy(", re.compile(r"\bcasadi_copy\((?=w\d|\(&w\d)")
"""CasADi's function that copies a vector unless it is NULL; a call of it for scratch memory, which is never NULL."""
COPY_FROM_WORK = """void casadi_copy_from_work(const casadi_real* x, casadi_int n, casadi_real* y) {
  casadi_int i;
  if (y) for (i=0; i<n; ++i) y[i] = x[i];
}

"""
"""The same copy without the branch for x = NULL, for which gcc 12 warns (-Warray-bounds)."""

FUNCTION = re.compile(r"(?:^/\*[^\n]*\*/\n)?^static int (casadi_f\d+)(\(.*?^}\n\n?)", re.MULTILINE | re.DOTALL)
"""A static function to which CasADi gave a number as its name, with the comment before it."""
NAME = re.compile(r"(#define )?\b(casadi_f\d+)\b(?(1).*\n)")
"""The name of an inner function, or the line that defines its prefix."""

WORK = re.compile(r"\*sz_(arg|res|iw|w) = (\d+);")
"""Size of scratch memory that a function declares."""

UNUSED = ("#include <stdarg.h>\n", "#include <stdio.h>\n")
"""Unused headers, which a robot's processor may lack."""


class Generated(NamedTuple):
    """C code of several functions, and the size of the scratch memory that the largest needs."""

    code: str
    notice: str
    """CasADi's note on the licence, from the first comment of the code."""
    arguments: int
    results: int
    integers: int
    reals: int


def generated(functions: Sequence[ca.Function]) -> Generated:
    """C code of all functions; each function is static and has its own name.

    An output may have the same memory as an input. The sizes of scratch memory are those of the virtual machine; the
    code needs no more. They include the additional integers of `optim/qrqp.py`, because qrqp writes one too many.

    Raises
    ------
    ConfigurationError : the installed CasADi writes code in another form.
    """
    generator = ca.CodeGenerator("generated", {"with_header": False})
    for function in functions:
        generator.add(function)
    with tempfile.TemporaryDirectory() as folder:
        generator.generate(f"{folder}/")
        text = (Path(folder) / "generated.c").read_text(encoding="utf-8")
    notice, end, code = text.partition("*/")
    sizes = {each: max(getattr(one, f"sz_{each}")() for one in functions) for each in ("arg", "res", "iw", "w")}
    fits = all(int(size) <= sizes[each] for each, size in WORK.findall(code))
    if not (notice.startswith("/*") and end and OLD_C in code and fits and _writes_last(code)):
        raise ConfigurationError("casadi", ca.CasadiMeta.version(), "a version that writes C of the form known here")
    for unused in UNUSED:
        code = code.replace(unused, "")
    code = FROM_WORK.sub("casadi_copy_from_work(", code).replace(COPY, COPY_FROM_WORK + COPY)
    code = _each_once(going_on_after_failed_solves(code))
    lines = (line.strip(" *") for line in notice.removeprefix("/*").splitlines())
    return Generated(
        code=DEFINITION.sub("static ", code.replace(OLD_C, COMPARISONS)).strip() + "\n",
        notice="\n".join(line for line in lines if line),
        arguments=sizes["arg"],
        results=sizes["res"],
        integers=sizes["iw"],
        reals=sizes["w"],
    )


def _writes_last(code: str) -> bool:
    """Whether every exported function reads all its inputs before it writes any output."""
    called = re.findall(r"return (casadi_f\d+)\(arg, res, iw, w, mem\)", code)
    bodies = (code.partition(f"static int {each}(")[2].partition("\n}")[0] for each in called)
    return bool(called) and not any(re.search(r"\b(arg|wr)\d*\b", body.partition(" res[")[2]) for body in bodies)


def _each_once(code: str) -> str:
    """C code with duplicate functions merged, because CasADi writes one for each instance."""
    name_of, first = dict[str, str](), dict[str, str]()

    def known(found: re.Match[str]) -> str:
        name = name_of.get(found[2], found[2])
        return found[0] if name == found[2] else "" if found[1] else name

    def kept(found: re.Match[str]) -> str:
        name, text = found[1], NAME.sub(known, found[2])
        name_of[name] = first.setdefault(text, name)
        return found[0] if name_of[name] == name else ""

    code = FUNCTION.sub(kept, code)
    return NAME.sub(known, code)


def renamed(function: ca.Function, name: str) -> ca.Function:
    """The same function under another name, which must be unique in its C file."""
    inputs = [ca.MX.sym(f"input_{i}", function.sparsity_in(i)) for i in range(function.n_in())]
    return ca.Function(name, inputs, function.call(inputs))
