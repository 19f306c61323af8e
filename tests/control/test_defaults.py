"""Numbers that a setting has where nobody gives it are those kept: the other tests give most settings."""

from __future__ import annotations

import inspect
from typing import Any

import rehab_opt
from rehab_opt.control.conditioning import Conditioner, conditioned
from rehab_opt.control.hand_bounds import HandBounds
from rehab_opt.control.scanning import Scanning
from tests.golden import assert_kept


def defaults(part: Any) -> dict[str, str]:
    """Numbers, and what is made of some, by name, as they are written."""
    given = inspect.signature(part).parameters.values()
    return {each.name: repr(each.default) for each in given if isinstance(each.default, int | float | tuple | dict)}


def test_defaults_are_those_kept() -> None:
    found, named = {}, [getattr(rehab_opt, name) for name in rehab_opt.__all__]
    for part in (*named, Conditioner, HandBounds, Scanning, conditioned):
        methods = [each for each in vars(part).values() if inspect.isfunction(each) and each.__name__[0] != "_"]
        own = [part] if "__init__" in vars(part) or inspect.isfunction(part) else []
        found |= {each.__qualname__: given for each in (*own, *methods) if (given := defaults(each))}
    assert_kept("control_defaults", found)
