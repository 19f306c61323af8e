"""A problem file with other values for some of its keys; comments and everything else stay as they are."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from rehab_opt.errors import ProblemFileError

__all__ = ["replaced_keys", "value_text"]


def value_text(value: float | str | list[float]) -> str:
    """A number, text or list of numbers as TOML."""
    if isinstance(value, list):
        return "[" + ", ".join(value_text(each) for each in value) + "]"
    return f'"{value}"' if isinstance(value, str) else f"{value:g}" if value != int(value) else f"{value:.1f}"


def replaced_keys(text: str, keys: dict[str, dict[str, Any]], *, file: str) -> str:
    """The text of a TOML file in which `keys[section][key]` has another value, or stands first in its section.

    Raises
    ------
    ProblemFileError : a section that is written in another way than under a header of its own.
    """
    lines = text.splitlines()
    for section, values in keys.items():
        headers = [
            i for i, line in enumerate(lines) if re.fullmatch(rf"\[{re.escape(section)}\]\s*(#.*)?", line.strip())
        ]
        if len(headers) != 1:
            raise ProblemFileError(file, section, len(headers), f"one line [{section}], with its keys below")
        begin = headers[0] + 1
        for key, value in values.items():
            end = next((i for i in range(begin, len(lines)) if lines[i].lstrip().startswith("[")), len(lines))
            new = f"{key} = {value_text(value)}"
            at = next((i for i in range(begin, end) if re.match(rf"\s*{re.escape(key)}\s*=", lines[i])), None)
            if at is None:
                lines.insert(begin, new)
                continue
            last = at
            while not _is_whole("\n".join(lines[at : last + 1])):
                last += 1
            comment = re.search(r"\s+#[^\"\]]*$", lines[last])
            lines[at : last + 1] = [new + (comment.group() if comment else "")]
    return "\n".join(lines) + "\n"


def _is_whole(text: str) -> bool:
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    return True
