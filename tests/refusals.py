"""Tables of arguments that a call refuses: a row holds the arguments and the words that the message must contain."""

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from rehab_opt import ConfigurationError

Row: TypeAlias = tuple[Mapping[str, Any] | tuple[Any, ...], *tuple[str, ...]]
"""Keyword arguments as a mapping, or positional arguments as a tuple; then the words."""


def refuses(
    call: Callable[..., object],
    *table: Row,
    error: type[Exception] | tuple[type[Exception], ...] = ConfigurationError,
) -> None:
    """Check that `call` refuses each row's arguments with `error` and each of its words; list all rows that fail."""
    assert table, "an empty table checks nothing"
    wrong = []
    for arguments, *words in table:
        assert words, f"{arguments}: the row names no words"
        try:
            returned = call(**arguments) if isinstance(arguments, Mapping) else call(*arguments)
        except error as refusal:
            wrong += [f"{arguments}: {word!r} is not in {str(refusal)!r}" for word in words if word not in str(refusal)]
        else:
            wrong.append(f"{arguments}: accepted, returned {returned!r}")
    assert not wrong, "\n".join(wrong)
