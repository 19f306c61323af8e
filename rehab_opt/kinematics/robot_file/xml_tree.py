"""Elements and attributes of an untrusted XML file: no entity is expanded and no other file is opened.

The standard library's expat is enough, since a robot's kinematics are attributes of a few elements. Errors of this
reader name the wrong joint and key. Errors of yourdfpy, pinocchio and MuJoCo do not name them; these packages also need
10 to 400 MB or open meshes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import RobotFileError
from rehab_opt.text_file import file_content, number_in, shown

__all__ = ["Element", "Source", "xml_root"]

Array = NDArray[np.float64]

LARGEST = 10_000_000
"""[byte] Largest accepted file; files of whole humanoids have less than a tenth of this size."""
DEEPEST = 200
"""Largest nesting depth; MJCF nests bodies."""
MAX_ELEMENTS = 30_000
LONGEST_KEY = 100
"""Longest key in a message, in characters."""
FARTHEST = 100.0
"""[m] Largest accepted length; a larger one is in another unit."""


@dataclass(frozen=True)
class Source:
    """A robot file, and the errors about its content.

    Parameters
    ----------
    path : path of the file. name : name of the file in errors.
    """

    path: Path
    name: str

    def refuse(self, key: str, value: object, expected: str) -> RobotFileError:
        """`RobotFileError` about a key of the file, for the caller to raise."""
        brief = shown(value) if isinstance(value, str) else value
        return RobotFileError(self.name, shown(key, LONGEST_KEY), brief, expected)


@dataclass
class Element:
    """One element with its attributes and children."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)

    def each(self, tag: str) -> Iterator[Element]:
        """Children with this tag."""
        return (child for child in self.children if child.tag == tag)

    def all(self) -> Iterator[Element]:
        """The element and all its descendants, in the file's order."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting += reversed(element.children)

    def only(self, tag: str, source: Source, owner: str) -> Element | None:
        """The only child with this tag, or None.

        Raises
        ------
        RobotFileError : there are several.
        """
        found = list(self.each(tag))
        if len(found) > 1:
            raise source.refuse(f"{owner}, {tag}", f"{len(found)} elements", "one")
        return found[0] if found else None

    def text(self, key: str, source: Source, owner: str) -> str:
        """A required attribute; `owner` is the element's name in errors.

        Raises
        ------
        RobotFileError : absent or empty.
        """
        value = self.attributes.get(key, "").strip()
        if not value:
            raise source.refuse(f"{owner}, {self.tag}.{key}", self.attributes.get(key), "a name")
        return value

    def numbers(self, key: str, source: Source, owner: str, default: Array, *, most: float = math.inf) -> Array:
        """(k,) numbers of an attribute; `default` (k,) replaces an absent one.

        Raises
        ------
        RobotFileError : not k finite numbers, or one above `most` in magnitude.
        """
        written = self.attributes.get(key)
        if written is None:
            return default
        parts = written.split()
        values = np.array([number_in(part) for part in parts[: len(default) + 1]], dtype=np.float64)
        if len(values) != len(default) or not np.all(np.abs(values) <= min(most, 1e300)):
            what = "a finite number" if len(default) == 1 else f"{len(default)} finite numbers"
            limit = "" if math.isinf(most) else f" from {-most:.5g} to {most:.5g} (another unit?)"
            raise source.refuse(f"{owner}, {self.tag}.{key}", written, what + limit)
        return values


def xml_root(source: Source) -> Element:
    """The root element of a file.

    Raises
    ------
    ProblemFileError : no regular file, or one larger than `LARGEST`. RobotFileError : not XML, nested too deeply, or
        with a document type, which could declare entities.
    """
    content = file_content(source.path, source.name, max_size=LARGEST)
    open_elements: list[Element] = []
    roots: list[Element] = []
    count = 0
    parser = expat.ParserCreate()

    def begin(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        element = Element(tag, attributes, parser.CurrentLineNumber)
        if count > MAX_ELEMENTS or len(open_elements) >= DEEPEST:
            what = f"{MAX_ELEMENTS} elements, {DEEPEST} deep"
            raise source.refuse(f"line {element.line}", f"<{tag}>", f"a robot's description, of at most {what}")
        (open_elements[-1].children if open_elements else roots).append(element)
        open_elements.append(element)

    def document_type(name: str, *_: object) -> None:
        where = f"line {parser.CurrentLineNumber}"
        raise source.refuse(where, f"<!DOCTYPE {name}>", "a robot's description, which declares no document type")

    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda _: open_elements.pop()
    parser.StartDoctypeDeclHandler = document_type
    try:
        parser.Parse(content, True)
    except expat.ExpatError as problem:
        what = expat.ErrorString(problem.code)
        raise source.refuse(f"line {problem.lineno}", what, "XML") from problem
    except RobotFileError:
        raise
    except (LookupError, ValueError) as problem:
        raise source.refuse(f"line {parser.CurrentLineNumber}, encoding", str(problem), "XML in UTF-8") from problem
    return roots[0]
