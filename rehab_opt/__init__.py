"""rehab_opt: controllers for rehabilitation and assistive robots, each posed as an optimisation problem."""

import importlib
import re
from pathlib import Path
from typing import Any

from rehab_opt.version import __version__ as __version__

# Public names are imported on first use, so an invalid argument is reported without loading CasADi. The stub
# `__init__.pyi` lists the module of each name.
_PLACES = {
    name: module
    for module, names in re.findall(
        r"^from (rehab_opt\.\S+) import (.+)$",
        Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    for name in re.findall(r"(\w+) as", names)
}
__all__ = [name for name in (*_PLACES, "measures") if name != "__version__"]


def __getattr__(name: str) -> Any:
    if name == "measures":  # a package that is used by its name, as in `rehab_opt.measures.score`
        return importlib.import_module(f"{__name__}.measures")
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
