"""The files of one exported controller, as text."""

from __future__ import annotations

import hashlib

import casadi as ca

from rehab_opt.control.command import NUMBERED, Relaxed
from rehab_opt.control.reasons import NOTES, REASONS
from rehab_opt.control.velocity_tick import VELOCITY_SOLVERS
from rehab_opt.export.c_text import comment, filled, indented, number
from rehab_opt.export.exported import ExportedController
from rehab_opt.export.generated import Generated, generated
from rehab_opt.optim.dual_active_set import STEPS
from rehab_opt.optim.qrqp import QRQP_ITERATIONS
from rehab_opt.version import __version__

__all__ = ["SOLVERS", "files_of"]

SOLVERS = VELOCITY_SOLVERS
"""Names of the solvers, in the order of the numbers that C returns; -1 means none."""


def files_of(exported: ExportedController, *, problem: str) -> dict[str, str]:
    """Text of every file by file name; `problem` describes the origin of the controller."""
    functions = exported.generated
    code = generated(functions)
    values = _values(exported, code, problem)
    values["command"] = filled("rehab_command.h", values)
    for name, part in exported.pieces.items():
        values[name] = filled(part, values)
    values["types"] += "\n\n" if values["types"] else ""
    values |= {"memory": filled(f"{exported.core}.h", values), "core": filled(f"{exported.core}.c", values)}
    computes = (code.code, values["core"], filled(f"{exported.interface}.c", values))
    values["model"] = hashlib.sha256("\n".join(computes).encode()).hexdigest()
    header = filled("header.h", {**values, "interface": filled(f"{exported.interface}.h", values)})
    source = filled("source.c", {**values, "interface": filled(f"{exported.interface}.c", values)})
    return {
        f"rehab_{exported.name}.h": header + "\n",
        f"rehab_{exported.name}.c": source + "\n",
        "recorded_run.h": filled("recorded_run.h", values) + "\n",
        "recorded_run.csv": exported.recording.csv(),
        "main.c": filled("main.c", values) + "\n",
        "CMakeLists.txt": filled("CMakeLists.txt", values) + "\n",
        "README.md": filled("README.md", values) + "\n",
    }


def _effort(solves: int) -> str:
    if not solves:
        return "A tick solves no QP by iterations: the answer has a closed form."
    most = max(STEPS, QRQP_ITERATIONS)
    solved = f"{solves} solves of {most} changes of the active set"
    return f"At worst a tick takes {solves * most} QP iterations ({solved}), then it gives the safe command."


def _values(exported: ExportedController, code: Generated, problem: str) -> dict[str, str]:
    shape, recording = exported.shape(), exported.recording
    arguments, results, reals = max(code.arguments, 3), max(code.results, 3), max(code.reals, 1)
    return {
        **shape,
        "arguments": str(arguments),
        "results": str(results),
        "integers": str(code.integers),
        "reals": str(reals),
        "name": exported.name,
        "guard": exported.name.upper(),
        "title": comment(exported.title),
        "problem": comment(problem),
        "casadi": ca.CasadiMeta.version(),
        "notice": "\n".join(f" *     {line}" for line in code.notice.splitlines()),
        "notice_quoted": "\n".join(f"> {line}  " for line in code.notice.splitlines()),
        "generated": code.code,
        "effort": _effort(exported.solves),
        "status_constants": ", ".join(f"REHAB_{status.name} = {i}" for i, status in enumerate(NUMBERED)),
        "relaxed_constants": ", ".join(f"REHAB_{each.name} = {int(each)}" for each in Relaxed),
        "reason_constants": indented(
            f"REHAB_{reason.name}{',' if reason is not REASONS[-1] else ''}" for reason in REASONS
        ),
        "solver_constants": indented(
            f"REHAB_{solver.upper().replace(' ', '_')}{',' if solver is not SOLVERS[-1] else ''}" for solver in SOLVERS
        ),
        "reason_cases": indented(f'case REHAB_{reason.name}: return "{reason.text}";' for reason in REASONS),
        "note_constants": indented(
            f"REHAB_{note.name} = {2**i}{',' if note is not NOTES[-1] else ''} /* {note.text} */"
            for i, note in enumerate(NOTES)
        ),
        "types": "",
        "more_memory": indented(exported.more_memory.splitlines()),
        "contents": exported.contents,
        "call": exported.call,
        "usage": exported.usage,
        "recording": recording.about,
        "comment": f"The recorded run: {comment(recording.about)}.",
        "fields": recording.fields(),
        "ticks": ",\n".join(recording.initialisers()),
        "count": str(len(recording.ticks)),
        "more": str(len(recording.more[0])),
        "more_room": str(max(1, len(recording.more[0]))),
        "differences": "\n".join(f"- {sentence}" for sentence in exported.differences),
        "size": f"about {round(exported.bytes / 1000)} kB",
        "bytes": str(exported.bytes),
        "version": __version__,
        "seconds": number(exported.dt),
        "limits": "\n".join(f" *     {comment(line)}" for line in exported.limits()),
        **exported.values,
    }
