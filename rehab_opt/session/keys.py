"""Tables of the keys of a problem file, derived from the schema that validates such files."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel

HIDDEN = ("system",)


class Keys(NamedTuple):
    """The keys of one table of a problem file."""

    head: str
    """Name and meaning of the table; empty for the file itself."""
    rows: list[tuple[str, str, str, str]]
    """For each key: name, values, default, meaning."""
    refused: str
    """Text that lists invalid combinations of keys; may be empty."""


def sections_within(annotation: Any) -> list[type[BaseModel]]:
    """The sections that a key with this type annotation may have as values, in the annotation's order."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [section for each in get_args(annotation) for section in sections_within(each)]


def attribute_docstrings(owner: type) -> dict[str, str]:
    """The docstring below each attribute of a class, by the attribute's name, including inherited attributes."""
    said: dict[str, str] = {}
    ours = {"rehab_opt", owner.__module__.partition(".")[0]}
    for each in reversed(owner.__mro__):
        if each.__module__.partition(".")[0] in ours:
            said |= _own_docstrings(each)
    return said


@cache
def _own_docstrings(owner: type) -> dict[str, str]:
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
    assert isinstance(tree, ast.ClassDef)
    said = {}
    for first, second in zip(tree.body, tree.body[1:], strict=False):
        match first, second:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                said[name] = " ".join(text.split())
    return said


def keys_of(
    schema: type[BaseModel], prefix: str = "", head: str = "", without: frozenset[str] = frozenset()
) -> Iterator[Keys]:
    """The keys of a schema, then of each table in it, as Markdown; tables named in `without` are not expanded."""
    said, described = defaultdict(str, attribute_docstrings(schema)), schema.model_json_schema()
    rows: list[tuple[str, str, str, str]] = []
    within: list[tuple[str, str, type[BaseModel]]] = []
    for key, field in schema.model_fields.items():
        if key in HIDDEN:
            continue
        named = f"{prefix}{key}"
        plain = described["properties"][key]
        sections = sections_within(field.annotation)
        if sections and named in without:
            rows.append((named, "a table", _default(field, plain), said[key]))
            continue
        listed = _is_list(plain, described)
        within += [(f"{named}{_element(plain, described)}.", named, section) for section in sections]
        if sections and not listed and len(_forms(plain, described)) == len(sections):
            continue  # the key's value is always a table, which is listed below
        rows.append((named, _values(plain, described), _default(field, plain), said[key]))
    yield Keys(head, rows, _refusals(schema))
    for below, named, section in within:
        optional = not schema.model_fields[named.removeprefix(prefix)].is_required()
        head = f"**`{named}`: {inspect.cleandoc(section.__doc__ or '')}**"
        yield from keys_of(section, below, head + (" The table may be left out." if optional else ""), without)


def _refusals(schema: type[BaseModel]) -> str:
    """Text that lists invalid combinations of keys, from the docstrings of the schema's validators."""
    checks = schema.__pydantic_decorators__.model_validators.values()
    lines = [inspect.getdoc(check.func) or "" for check in checks if check.info.mode == "after"]
    return "Refused: " + "; ".join(line.removeprefix("Refuse ").rstrip(".") for line in lines) + "." if lines else ""


def _element(plain: dict[str, Any], whole: dict[str, Any]) -> str:
    if any(isinstance(form.get("additionalProperties"), dict) for form in _forms(plain, whole)):
        return ".NAME"
    return "[]" if _is_list(plain, whole) else ""


def _is_list(plain: dict[str, Any], whole: dict[str, Any]) -> bool:
    return any(form.get("type") == "array" for form in _forms(plain, whole))


def _forms(plain: dict[str, Any], whole: dict[str, Any]) -> list[dict[str, Any]]:
    """The alternative JSON schemas of a value, with references resolved and without null."""
    if "$ref" in plain:
        return _forms(whole["$defs"][plain["$ref"].rpartition("/")[2]], whole)
    for word in ("anyOf", "oneOf", "allOf"):
        if word in plain:
            return [form for each in plain[word] for form in _forms(each, whole) if form.get("type") != "null"]
    return [plain]


def _values(plain: dict[str, Any], whole: dict[str, Any]) -> str:
    return ", or ".join(dict.fromkeys(_form(form, whole) for form in _forms(plain, whole)))


def _form(form: dict[str, Any], whole: dict[str, Any]) -> str:
    if "const" in form or "enum" in form:
        return ", ".join(f'`"{each}"`' for each in form.get("enum", [form.get("const")]))
    kind = form.get("type")
    if kind == "array":
        least, most = form.get("minItems"), form.get("maxItems")
        inner = _values(form.get("items", {}), whole)
        number = f"{least}" if least == most and least else f"{least or 0} to {most}" if most else "any number"
        return f"list of {number}: {inner}"
    if kind == "object":
        return "a table" if "properties" in form else f"a table of: {_values(form['additionalProperties'], whole)}"
    if kind in ("boolean", "string"):
        return "`true`, `false`" if kind == "boolean" else "text"
    return _interval(form, "whole number" if kind == "integer" else "number")


def _interval(form: dict[str, Any], word: str) -> str:
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    ends = [f"{signs[key]} {form[key]:.12g}" for key in signs if key in form]
    return ", ".join((word, *ends))


def _default(field: Any, plain: dict[str, Any]) -> str:
    if field.is_required():
        return "required"
    value = plain.get("default")
    if value in (None, []) or (isinstance(value, dict) and sections_within(field.annotation)):
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{value:.12g}`" if isinstance(value, float) else f"`{value}`".replace("'", '"')
