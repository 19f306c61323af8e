"""Which versions a recording was made with."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

__all__ = ["versions_now"]


def versions_now() -> dict[str, str]:
    """Of the library and of what its numbers depend on; a checkout that is not installed has none."""
    found = {}
    for name in ("rehab_opt", "casadi", "numpy"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "a checkout"
    return found
