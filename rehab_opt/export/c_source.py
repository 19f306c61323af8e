"""The files of one exported controller, as text."""

from __future__ import annotations

import casadi as ca
import numpy as np

from rehab_opt.control.watchdog import DRIFT
from rehab_opt.export.c_text import comment, filled, indented, initialiser, number
from rehab_opt.export.exported import ExportedController
from rehab_opt.export.generated import Generated, generated, renamed
from rehab_opt.export.reasons import REASONS
from rehab_opt.optim.qp import PLAUSIBLE

__all__ = ["files_of"]

VERDICT = 3
"""Numbers of a verdict before its report."""
BYTES = 8


def files_of(exported: ExportedController, *, problem: str) -> dict[str, str]:
    """Content of every file by its name."""
    code = generated(_functions(exported))
    values = _values(exported, code, problem)
    values |= {
        "command": filled("rehab_command.h", values),
        "memory": filled("velocity_controller.h", values),
        "core": filled("velocity_controller.c", values),
    }
    header = filled("header.h", {**values, "interface": filled(f"{exported.interface}.h", values)})
    source = filled("source.c", {**values, "interface": filled(f"{exported.interface}.c", values)})
    recording = exported.recording
    return {
        f"rehab_{exported.name}.h": header + "\n",
        f"rehab_{exported.name}.c": source + "\n",
        "recorded_run.h": filled("recorded_run.h", values) + "\n",
        "recorded_run.csv": recording.csv(),
        "main.c": filled("main.c", values) + "\n",
        "CMakeLists.txt": filled("CMakeLists.txt", values) + "\n",
        "README.md": filled("README.md", values) + "\n",
    }


def _functions(exported: ExportedController) -> list[ca.Function]:
    """All that is generated: of each law its tick, its safe command, and its lesser law where there is one."""
    functions = []
    for law in exported.laws:
        functions += [
            renamed(law.controller.stated.fused, f"{law.name}_tick"),
            renamed(law.controller.braking(), f"{law.name}_brake"),
        ]
        if law.lesser is not None:
            functions.append(renamed(law.lesser, f"{law.name}_lesser"))
    return functions


def _values(exported: ExportedController, code: Generated, problem: str) -> dict[str, str]:
    """What stands for the names in the templates."""
    laws, recording = exported.laws, exported.recording
    first = laws[0].controller
    chain, watchdog = first.chain, first._watchdog
    lower, upper = np.maximum(chain.lower, -PLAUSIBLE), np.minimum(chain.upper, PLAUSIBLE)
    wheels = first.wheels
    sizes = {
        "joints": chain.n,
        "laws": len(laws),
        "parameters_most": max(law.controller.stated.parameter_size for law in laws),
        "state_most": max(law.state for law in laws),
        "memory_most": max(law.memory for law in laws),
        "verdict_most": VERDICT + max(law.reported for law in laws),
        "inputs_most": max(len(law.controller.stated.parameters) for law in laws),
        "obstacle_room": max(1, *(law.obstacles for law in laws)),
        "arguments": max(code.arguments, 3),
        "results": max(code.results, 3),
        "integers": code.integers,
        "reals": max(code.reals, 1),
        "iterations": max(law.iterations for law in laws),
        "solves": exported.solves,
        "values": chain.n,
        "wheels": 0 if wheels is None else wheels.stop - wheels.start,
        "count": len(recording.ticks),
    }
    memory = len(laws) * (sizes["parameters_most"] + 2 * sizes["state_most"] + sizes["verdict_most"])
    memory += sizes["arguments"] + sizes["results"] + sizes["integers"] + sizes["reals"]
    return {
        **{name: str(size) for name, size in sizes.items()},
        "name": exported.name,
        "guard": exported.name.upper(),
        "title": comment(exported.title),
        "problem": comment(problem),
        "casadi": ca.CasadiMeta.version(),
        "notice": "\n".join(f" *     {line}" for line in code.notice.splitlines()),
        "notice_quoted": "\n".join(f"> {line}  " for line in code.notice.splitlines()),
        "generated": code.code,
        "reason_constants": indented(
            f"REHAB_{reason.name}{',' if reason is not REASONS[-1] else ''}" for reason in REASONS
        ),
        "reason_cases": indented(f'case REHAB_{reason.name}: return "{reason.text}";' for reason in REASONS),
        "work_functions": ", ".join(f"{function.name()}_work" for function in _functions(exported)),
        "law_shapes": indented(law.row() + "," for law in laws).rstrip(","),
        "plausible": number(PLAUSIBLE),
        "tolerance": number(first.tolerance),
        "dt": number(first.dt),
        "max_age": number(watchdog.max_age),
        "gained": number(first.dt * (1.0 - DRIFT)),
        "middle": initialiser((lower + upper) / 2),
        "fastest": initialiser(chain.velocity),
        "more_memory": indented(exported.more_memory.splitlines()),
        "call": exported.call,
        "usage": exported.usage,
        "recording": recording.about,
        "comment": f"The recorded run: {comment(recording.about)}.",
        "fields": recording.fields(),
        "ticks": ",\n".join(recording.initialisers()),
        "differences": "\n".join(f"- {sentence}" for sentence in exported.differences),
        "size": f"about {round(BYTES * memory / 1024)} kB",
        **exported.values,
    }
