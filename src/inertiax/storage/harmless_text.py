"""Text that comes from files, such as names of devices and columns, made harmless for terminals and messages."""

import re


LONGEST_NAME = 40  # characters of a name that a message repeats
LONGEST_WORD = 120  # characters without a space or a slash: longer than any name that people give
LONGEST_LINE = 2000  # characters of a message: a screenful


def harmless(text: str) -> str:
    """Text that a terminal cannot take for commands.

    Characters that do not print (escape, backspace, marks that reverse the direction of writing, halves of a
    surrogate pair) become �, except line breaks and tabs; words that are too long to read are cut.
    """
    plain = "".join(c if c.isprintable() or c in "\n\t" else "�" for c in text)
    return _WORD.sub(lambda found: f"{found[0][:LONGEST_NAME]}…", plain)


def one_line(text: str) -> str:
    """Harmless text as one line that is not longer than a screen."""
    line = harmless(" ".join(text[: 4 * LONGEST_LINE].split()))
    return line if len(line) <= LONGEST_LINE else f"{line[:LONGEST_LINE]}…"


def short(text: str) -> str:
    """A name from a file as a message repeats it: one line, not long."""
    plain = "".join(c if c.isprintable() else "�" for c in text[:LONGEST_NAME])
    return f"{plain}…" if len(text) > LONGEST_NAME else plain


_WORD = re.compile(rf"[^\s/\\]{{{LONGEST_WORD + 1},}}")
