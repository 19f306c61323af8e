"""Formulas as MathML, made when the pages are built: browsers draw it without scripts or fonts from elsewhere."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert

UNREAD = ("<mi>&</mi>", "\\")
"""Remains of an environment or command that the converter does not know."""


def mathml(formula: str, display: str) -> str:
    r"""A formula of LaTeX; lines that are aligned are `\begin{aligned}`, as other readers of Markdown know them."""
    made = convert(formula.replace("{aligned}", "{align*}"), display=display)
    if any(sign in made for sign in UNREAD):
        raise ValueError(f"latex2mathml does not read all of {formula!r}")
    return made


def inline_math(translator: Any, node: nodes.math) -> None:
    """A formula within a line."""
    translator.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def display_math(translator: Any, node: nodes.math_block) -> None:
    """A displayed formula."""
    translator.body.append(f'<div class="formula">{mathml(node.astext(), "block")}</div>\n')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    """Make `mathml` a value of `html_math_renderer`."""
    app.add_html_math_renderer("mathml", (inline_math, None), (display_math, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
