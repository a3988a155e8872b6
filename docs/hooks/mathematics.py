"""Formulas as MathML, which browsers draw by themselves: no script, no fonts, nothing from a network."""

import html
import re

from latex2mathml.converter import convert


# As `pymdownx.arithmatex` leaves them, in its generic form.
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', flags=re.DOTALL)


def rendered(page: str) -> str:
    """A page's HTML with its TeX turned into MathML; the TeX stays as what a reader without it is told."""
    return FORMULA.sub(_one, page)


def _one(found: re.Match[str]) -> str:
    tex = html.unescape(found[3]).strip()
    drawn = convert(tex, display="block" if found[2] == "[" else "inline")
    return drawn.replace("<math ", f'<math alttext="{html.escape(tex)}" ', 1)
