"""Numbers along an axis."""

from matplotlib.ticker import ScalarFormatter


_RAISED = str.maketrans("-−0123456789", "⁻⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Numbers(ScalarFormatter):
    """Numbers along an axis as plain text, a common power of ten as ×10⁻⁵.

    matplotlib's own typesets every label as mathematics, which takes longer than all else in a figure.
    """

    def __init__(self):
        super().__init__(useOffset=False, useMathText=False)

    def get_offset(self) -> str:
        power = super().get_offset()  # such as 1e−5, or nothing
        return f"×10{power[2:].translate(_RAISED)}" if power else ""
