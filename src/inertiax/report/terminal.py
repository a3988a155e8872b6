"""A console for results and progress, on which text of files stays text."""

from typing import Any

from rich.console import Console
from rich.text import Text

from ..storage.harmless_text import harmless


class Terminal(Console):
    """Rich's console without its markup and its guesses, for text that files may have written."""

    def __init__(self, **options: Any):
        super().__init__(highlight=False, markup=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """What every piece of text passes: lines printed, cells and headings of tables."""
        return super().render_str(harmless(text), **options)
