"""One style for all figures: colours told apart by colour-blind readers, text in one ink."""

import functools
import hashlib
import io
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING


if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
else:  # matplotlib is imported where something is drawn: `drawing.drawn_aside`
    Axes = Figure = Any


# Okabe and Ito (2008), Color Universal Design: told apart with every kind of colour vision.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
MARKERS = ("o", "s", "^", "D", "v", "P")
DASHES = ("-", "--", "-.", ":")
INK = "#262626"
QUIET = "#8c8c8c"
AXIS_NAMES = ("x", "y", "z")

_FONT = "DejaVu Sans"  # comes with matplotlib, so a figure is the same everywhere
# Families with the scripts of China, Japan and Korea: of Linux, of Windows, of macOS
_FURTHER = (
    "Noto Sans CJK SC", "Noto Sans CJK JP", "Noto Sans CJK KR", "Noto Sans SC", "Noto Sans JP", "Noto Sans KR",
    "Source Han Sans SC", "WenQuanYi Zen Hei", "WenQuanYi Micro Hei", "Droid Sans Fallback", "IPAGothic", "NanumGothic",
    "Microsoft YaHei", "SimHei", "Yu Gothic", "MS Gothic", "Malgun Gothic",
    "PingFang SC", "Heiti TC", "Hiragino Sans", "Hiragino Sans GB", "Apple SD Gothic Neo", "Arial Unicode MS",
)  # fmt: skip

_STYLE = {
    "axes.axisbelow": True,
    "axes.edgecolor": QUIET,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelsize": 9,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9.5,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 6),
    "figure.autolayout": False,  # `new_figure` says which layout
    "figure.constrained_layout.use": False,
    "figure.facecolor": "white",
    "font.size": 9,
    "grid.color": QUIET,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "lines.markersize": 3.5,
    "svg.fonttype": "path",  # no font needed where the page is read
    "svg.hashsalt": "inertiax",  # the same figure gives the same file
    "text.color": INK,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
}


@contextmanager
def drawing() -> Iterator[None]:
    """The style, for the time of drawing only: a user's own settings stay as they are."""
    import matplotlib as mpl

    own: Any = _STYLE | {"font.family": families()}
    with mpl.rc_context(own):
        yield


@functools.cache
def families() -> list[str]:
    """The figures' font, and installed ones for what it lacks: logs' names in Chinese, Japanese, Korean."""
    from matplotlib.font_manager import fontManager

    installed = {font.name for font in fontManager.ttflist}
    return [_FONT, *(name for name in _FURTHER if name in installed)]


def new_figure(
    rows: int,
    columns: int,
    *,
    width: float = 7.2,
    height: float,
    sharex: bool = False,
    sharey: bool = False,
) -> tuple[Figure, list[Axes]]:
    """A figure with its axes in reading order. Sizes in inches."""
    from matplotlib.figure import Figure

    from .axis_numbers import Numbers

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False, sharex=sharex, sharey=sharey).flat)
    for ax in axes:
        ax.xaxis.set_major_formatter(Numbers())
        ax.yaxis.set_major_formatter(Numbers())
    return figure, axes


def legend_above(ax: Axes, *, columns: int = 3) -> Axes:
    """The legend over the right end of the axes, where no data can be."""
    ax.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=columns,
        borderaxespad=0.1,
        handlelength=1.6,
        columnspacing=1.2,
        markerscale=1.6,
    )
    return ax


def save_png(figure: Figure, path: Path) -> None:
    """Write a picture for documents and slides."""
    path.write_bytes(to_png(figure))


class Forms(NamedTuple):
    """A figure as SVG for a page, and as PNG."""

    svg: str  # an `<svg>` element
    png: bytes
    width: float  # inches


def both_forms(figure: Figure) -> Forms:
    """The figure as SVG and PNG, laid out once: each saving would draw all of it to lay it out."""
    layout = figure.get_layout_engine()
    if layout is not None:
        with drawing():
            layout.execute(figure)
            figure.set_layout_engine(None)
    return Forms(to_svg(figure), to_png(figure), float(figure.get_size_inches()[0]))


def to_png(figure: Figure) -> bytes:
    """A picture for documents and slides."""
    buffer = io.BytesIO()
    with drawing():
        figure.savefig(buffer, format="png", dpi=160, metadata={"Software": None})
    return buffer.getvalue()


def to_svg(figure: Figure) -> str:
    """The figure as an `<svg>` element to stand inside a page.

    Text and axes take the page's text colour, so the figure is readable on light and dark.
    """
    buffer = io.StringIO()
    with drawing():
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    return _shorten(text).replace(INK, "currentColor").strip()


def _shorten(svg: str) -> str:
    """Coordinates to a hundredth of a point: finer cannot be seen, and they are most of the file."""
    number = lambda m: f"{float(m.group()):.2f}".rstrip("0").rstrip(".")
    attribute = lambda m: re.sub(r"-?\d+\.\d+", number, m.group())
    svg = re.sub(r'\b(?:d|x|y)="[^"]*"', attribute, svg)
    return _styles_once(re.sub(r"\n\s*", "\n", svg))


def _styles_once(svg: str) -> str:
    """Styles that repeat (every marker has its own) as classes, named by their content so that
    figures in one page agree on them."""
    rules = []
    for style, times in Counter(re.findall(r'style="([^"]*)"', svg)).items():
        if times > 3:
            name = "s" + hashlib.sha256(style.encode()).hexdigest()[:8]
            svg = svg.replace(f'style="{style}"', f'class="{name}"')
            rules.append(f".{name}{{{style}}}")
    head = svg.index(">", svg.index("<svg")) + 1
    return f"{svg[:head]}<style>{''.join(rules)}</style>{svg[head:]}"


def installed_fonts() -> list[Path]:
    """Font files of this machine: TrueType, OpenType and collections of them."""
    from matplotlib.font_manager import findSystemFonts

    return sorted(map(Path, findSystemFonts()))


def characters_of(font: Path) -> frozenset[str]:
    """Characters that a font file has glyphs for; none of a damaged one."""
    from matplotlib.ft2font import FT2Font

    try:
        return frozenset(map(chr, FT2Font(str(font)).get_charmap()))
    except (RuntimeError, OSError):
        return frozenset()


def font_files() -> dict[str, Path]:
    """Files of the figures' font by style ("", "B"), for documents that stand beside them."""
    import matplotlib as mpl

    folder = Path(mpl.get_data_path()) / "fonts" / "ttf"
    return {"": folder / "DejaVuSans.ttf", "B": folder / "DejaVuSans-Bold.ttf"}
