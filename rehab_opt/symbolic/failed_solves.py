"""What generated code does where CasADi's qrqp fails."""

from __future__ import annotations

import re

__all__ = ["going_on_after_failed_solves"]

EARLY_RETURN = re.compile(
    r"if \(d\.status == QP_SUCCESS\) \{;?\s*return 0;"
    r"\s*\} else if \(d\.status == QP_NO_SEARCH_DIR\) \{\s*return [^;]+;"
    r"\s*\} else \{\s*return [^;]+;\s*\}"
)


def going_on_after_failed_solves(code: str) -> str:
    """The same C, in which a failed qrqp leaves its last point and goes on, as the virtual machine does.

    As it comes it returns an error, whatever `error_on_fail` says, and with it every function around it before anything
    is written: no certificate judges that point, and what was stated for the case of a failure never runs. An arm that
    starts singular was seen to stay there for that.
    """
    return EARLY_RETURN.sub("", code)
