"""Which tests a fault concerns: those of its folder, those nearest to its module first."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ELSEWHERE = {"recordings": "session"}
"""Folders of the library whose tests stand in another one's folder."""
FAR = 99
NEAREST, FIRST = 6, 2
"""Test files that run first; of these, how many before kept numbers, which see most faults."""


def folder(file: str) -> str:
    """Folder of the library that a file belongs to; "" of a single module."""
    return parts[1] if len(parts := Path(file).parts) > 2 else ""


def test_files(root: Path, file: str) -> list[str]:
    """Test files of a module's folder in a copy of the tree: the nearest to the module first, then the shortest."""
    name = folder(file)
    place = root / "tests" / ELSEWHERE.get(name, name)
    found = place.rglob("test_*.py") if name else place.glob("test_*.py")
    distances = distance_of_tests(file)
    words = {word for part in Path(file).with_suffix("").parts[1:] for word in part.split("_")}

    def order(test: Path) -> tuple[float, int]:
        alike = len(words & {*test.stem.split("_"), *test.relative_to(place).parts[:-1]})
        return distances.get(ROOT / test.relative_to(root), FAR) - alike, test.stat().st_size

    near = sorted(found, key=order)
    first = {*near[:FIRST], *(test for test in near if test.stem.startswith("test_kept_"))}
    near.sort(key=lambda test: test not in first)
    far = sorted(near[NEAREST:], key=lambda test: test.stat().st_size)
    return [str(test.relative_to(root)) for test in (*near[:NEAREST], *far)]


def distance_of_tests(file: str) -> dict[Path, int]:
    """Number of imports between each Python file and a module."""
    found, latest = {ROOT / file: 0}, {ROOT / file}
    while latest:
        latest = {path for path, used in graph().items() if path not in found and used & latest}
        found |= dict.fromkeys(latest, max(found.values()) + 1)
    return found


@cache
def graph() -> dict[Path, set[Path]]:
    """File -> files that it imports."""
    modules = {}
    for path in sorted([*(ROOT / "rehab_opt").rglob("*.py"), *(ROOT / "tests").rglob("*.py")]):
        parts = path.relative_to(ROOT).with_suffix("").parts
        modules[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    trees = {path: ast.parse(path.read_bytes()) for path in modules.values()}
    package = {
        name.name: f"{node.module}.{name.name}"
        for node in ast.walk(trees[modules["rehab_opt"]])
        if isinstance(node, ast.ImportFrom)
        for name in node.names
    }
    return {path: {modules[name] for name in imported(tree, package, modules)} for path, tree in trees.items()}


def imported(tree: ast.Module, package: dict[str, str], modules: dict[str, Path]) -> set[str]:
    """Names of modules that a file imports; what the package hands on counts as from where it stands."""
    names = set[str]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {each.name for each in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            full = [f"{node.module}.{each.name}" for each in node.names]
            names |= {package.get(name.removeprefix("rehab_opt."), name) for name in full}
    return {module for name in names for module in (name, name.rpartition(".")[0]) if module in modules} - {"rehab_opt"}
