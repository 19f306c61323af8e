"""What the package promises from outside: light to import, typed, layered."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import rehab_opt

PACKAGE = Path(rehab_opt.__file__).parent
HEAVY = {
    "matplotlib", "scipy", "ruckig", "osqp", "proxsuite", "qpsolvers", "pydantic", "typer", "rich", "shapely",
    "platformdirs", "skimage", "distributed", "mujoco", "pyxdf", "pyarrow", "jinja2",
}  # fmt: skip
# Each layer with those it may use. `session` runs the published laws beside ours; nobody else knows them.
LAYERS = {
    "version": set(),
    "errors": set(),
    "text_file": {"errors"},
    "symbolic": {"errors"},
    "kinematics": {"errors", "text_file", "symbolic"},
    "optim": {"errors", "symbolic"},
    "measures": {"errors", "kinematics"},
    "recordings": {"errors", "text_file"},
    "workspace": {"errors", "text_file", "symbolic", "kinematics", "optim"},
    "field": {"errors", "symbolic", "kinematics", "optim"},
    "control": {"errors", "symbolic", "kinematics", "optim", "workspace", "field"},
    "published": {"errors", "symbolic", "kinematics"},
    "session": {
        "errors", "text_file", "symbolic", "kinematics", "optim", "workspace", "field", "control", "published",
        "plants", "measures", "recordings",
    },
    "plants": {"errors", "kinematics", "workspace"},
    "export": {"version", "errors", "optim", "workspace", "field", "control", "session"},
    "live": {"errors", "control", "loop", "session"},
    "loop": {"version", "errors", "text_file", "kinematics", "control", "plants", "recordings", "session"},
    "terminal": {"errors", "text_file", "session", "symbolic"},
    "study": {"version", "errors", "text_file", "measures", "recordings", "session", "terminal"},
    "cli": {
        "version", "errors", "recordings", "session", "export", "live", "loop", "terminal", "study",
    },
}  # fmt: skip

PUBLIC_OF_TUPLES = {"_replace", "_fields", "_make", "_asdict"}

# Modules that import one another, lazily or for types alone counted, and why.
CIRCLES = {
    (
        "control.mirror",
        "control.mirror_plan",
        "control.mirror_retiming",
    ): "`MirrorTracker.plan` is a method that fills two files of its own",
    ("field.learning", "field.potential"): "`PotentialField.learn` is a constructor that fills a file of its own",
}


@cache
def nodes(file: Path) -> tuple[ast.AST, ...]:
    """All of a file's syntax tree, parsed once for all tests."""
    return tuple(ast.walk(ast.parse(file.read_text())))


def fresh(code: str) -> str:
    """What a new interpreter prints."""
    done = subprocess.run([sys.executable, "-c", code], cwd=PACKAGE.parent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def imported(file: Path) -> Iterator[str]:
    """Layers of this package that a file imports anywhere in it, also within functions and for types alone."""
    for node in nodes(file):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        for name in names:
            first, _, rest = name.partition(".")
            if first == "rehab_opt":
                yield rest.partition(".")[0]


def test_modules_import_one_another_only_for_a_reason() -> None:
    files = {".".join(file.relative_to(PACKAGE).with_suffix("").parts): file for file in PACKAGE.rglob("*.py")}
    packages = {name.removesuffix("__init__").rstrip("."): name for name in files if name.endswith("__init__")}
    uses = {
        name: {packages.get(each, each) for each in modules(file) if each in files or each in packages} - {name}
        for name, file in files.items()
    }

    def reached(start: str) -> set[str]:
        seen, to_see = set(), [start]
        while to_see:
            new = uses[to_see.pop()] - seen
            seen |= new
            to_see += new
        return seen

    reach = {name: reached(name) for name in uses}
    circles = {
        tuple(sorted(each for each in reach[name] if name in reach[each])) for name in uses if name in reach[name]
    }
    assert circles == set(CIRCLES)


def modules(file: Path) -> Iterator[str]:
    """Modules of this package that a file imports anywhere in it, by their names below the package."""
    for node in nodes(file):
        if isinstance(node, ast.ImportFrom) and str(node.module).partition(".")[0] == "rehab_opt":
            yield str(node.module).removeprefix("rehab_opt").lstrip(".")
            yield from (f"{node.module}.{each.name}".removeprefix("rehab_opt.") for each in node.names)


@pytest.mark.parametrize("module", ["rehab_opt", "rehab_opt.cli"])
def test_importing_loads_no_solver_and_no_plot(module: str) -> None:
    needed = {"typer", "rich"} if module == "rehab_opt.cli" else set()
    code = f"import sys, casadi, numpy; before = set(sys.modules); import {module}; print(*set(sys.modules) - before)"
    config = {name.partition(".")[0] for name in fresh(code).split()}
    assert sorted(config & HEAVY - needed) == []


def private_names(*folders: Path) -> set[str]:
    """Attributes and methods with a leading underscore of the classes in these folders."""
    found = set()
    for folder in folders:
        for file in folder.rglob("*.py"):
            for node in nodes(file):
                if isinstance(node, ast.ClassDef):
                    inside = [each for each in ast.walk(node) if isinstance(each, ast.Attribute | ast.FunctionDef)]
                    found |= {each.attr if isinstance(each, ast.Attribute) else each.name for each in inside}
    return {name for name in found if name.startswith("_") and not name.startswith("__")} - PUBLIC_OF_TUPLES


def test_tests_reach_no_private_attribute_of_a_controller() -> None:
    """Whoever reworks a controller keeps what these tests say of it, not how it is made."""
    private = private_names(PACKAGE / "control", PACKAGE / "optim")
    assert {"_solvers", "_owner", "_search", "_last"} <= private
    reached = []
    named = re.compile(rf"\b({'|'.join(private)})\b")
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        for node in nodes(file) if named.search(file.read_text()) else ():
            if isinstance(node, ast.Attribute) and node.attr in private:
                own = isinstance(node.value, ast.Name) and node.value.id in {"self", "cls"}
                if not own:
                    reached.append(f"{file.name}:{node.lineno}: {node.attr}")
            elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("setattr"):
                names = [each.value for each in node.args if isinstance(each, ast.Constant)]
                reached += [f"{file.name}:{node.lineno}: {name}" for name in names if name in private]
    assert reached == []


def test_importing_compiles_and_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("REHAB_OPT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("REHAB_OPT_COMPILE", "wait")
    fresh("import rehab_opt")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("layer", sorted(LAYERS))
def test_arrows_between_layers_point_one_way(layer: str) -> None:
    files = [PACKAGE / f"{layer}.py"] if (PACKAGE / f"{layer}.py").exists() else sorted((PACKAGE / layer).rglob("*.py"))
    assert files
    for file in files:
        wrong = set(imported(file)) - LAYERS[layer] - {layer}
        assert not wrong, f"{file.relative_to(PACKAGE)} imports {', '.join(sorted(wrong))}"


def test_every_module_belongs_to_a_layer() -> None:
    here = {path.relative_to(PACKAGE).parts[0].removesuffix(".py") for path in PACKAGE.rglob("*.py")}
    assert here - {"__init__", "__main__", "problems"} == set(LAYERS)


def test_nobody_catches_every_exception() -> None:
    for file in PACKAGE.rglob("*.py"):
        for node in nodes(file):
            if isinstance(node, ast.ExceptHandler):
                caught = {name.id for name in ast.walk(node.type) if isinstance(name, ast.Name)} if node.type else {""}
                assert not caught & {"", "Exception", "BaseException"}, f"{file}:{node.lineno}"
