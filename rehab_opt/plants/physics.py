"""MuJoCo where it is installed, and a refusal that says how to install it where it is not."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from rehab_opt.errors import ConfigurationError

__all__ = ["EXTRA", "mujoco_module"]

EXTRA = "physics"
"""The extra of this package that brings MuJoCo."""


def mujoco_module() -> Any:
    """The module `mujoco`.

    Raises
    ------
    ConfigurationError : it is not installed.
    """
    try:
        return import_module("mujoco")
    except ImportError as absent:
        expected = f"MuJoCo, which is not installed: pip install 'rehab_opt[{EXTRA}]'"
        raise ConfigurationError("plant", "mujoco", expected) from absent
