"""`explorer.html`: residuals to look through by hand, in one file that loads nothing.

The plot is Bokeh's (an extra, `pip install 'inertiax[explore]'`), whose script is put in compressed. Numbers are
16 bits between the least and the greatest of a column, which no screen can tell from the values.
"""

import base64
import gzip
import json
from collections.abc import Sequence
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from jaxtyping import Float
from jinja2 import Environment, PackageLoader, StrictUndefined

from ..diagnose.residuals import Residuals
from ..plots.residual_columns import Column, Table, table
from ..storage.whole_files import write_atomically


MOST_POINTS = 100_000  # blocks times channels of a page; of more an even choice is shown
LEVELS = 65535


def require_bokeh() -> None:
    """Raise `ValueError` with the cure where Bokeh is not installed."""
    if find_spec("bokeh") is None:
        raise ValueError(
            "--explore needs Bokeh: pip install 'inertiax[explore]', or leave the option out."
        )


def write_explorer(residuals: Sequence[Residuals], file: Path, *, title: str) -> None:
    """Write the page of a device's triads. Raises `ValueError` where Bokeh is not installed."""
    require_bokeh()
    from bokeh.core.types import ID  # heavy, and an extra
    from bokeh.embed import json_item

    tables = [_thinned(table(rows), len(residuals)) for rows in residuals]
    packed, layout = _packed(tables)
    environment = Environment(
        loader=PackageLoader("inertiax", "templates"), autoescape=True, undefined=StrictUndefined
    )
    text = environment.get_template("explorer.html").render(
        title=title,
        library=_compressed(_library()),
        numbers=_compressed(packed),
        layout=json.dumps(layout).replace("<", "\\u003c"),
        figure=json.dumps(json_item(_figure(), ID("plot"))).replace("<", "\\u003c"),
    )
    write_atomically(file, text.encode())


def _library() -> bytes:
    """Bokeh's script; the part that draws by WebGL is left out, since not every machine has it."""
    script = files("bokeh") / "server" / "static" / "js" / "bokeh.min.js"
    return script.read_bytes()


def _figure():
    """An empty plot, which the page's own script fills."""
    from bokeh.models import ColumnDataSource, HoverTool, LinearColorMapper
    from bokeh.plotting import figure

    source = ColumnDataSource({"x": [], "y": [], "c": []}, name="points")
    colours = LinearColorMapper(palette="Viridis256", name="colours")
    made = figure(
        sizing_mode="stretch_both", output_backend="canvas", name="figure",
        tools="pan,box_zoom,wheel_zoom,reset,save", active_drag="box_zoom",
    )  # fmt: skip
    made.scatter(
        "x", "y", source=source, size=3, line_color=None,
        fill_color={"field": "c", "transform": colours}, fill_alpha=0.6,
    )  # fmt: skip
    made.add_tools(HoverTool(tooltips=[("x", "@x"), ("residual", "@y"), ("colour", "@c")], limit=1))
    made.toolbar.logo = None
    return made


def _thinned(full: Table, triads: int) -> Table:
    """An even choice of the blocks where there are more than a page shows."""
    blocks, channels = len(full.variables[0].values), len(full.before)
    step = -(-blocks * channels * triads // MOST_POINTS)
    cut = lambda columns: tuple(c._replace(values=c.values[::step]) for c in columns)
    return Table(full.name, cut(full.variables), cut(full.before), cut(full.effects))


def _packed(tables: Sequence[Table]) -> tuple[bytes, list[dict]]:
    """Numbers of all columns one after the other, and where each is."""
    pieces: list[bytes] = []
    place = 0

    def put(column: Column) -> dict:
        nonlocal place
        values, low, step = quantised(column.values)
        pieces.append(np.diff(values, prepend=np.uint16(0)).astype("<u2").tobytes())
        said = {"name": column.name, "unit": column.unit, "low": low, "step": step, "at": place}
        place += len(values)
        return said

    layout = [
        {
            "triad": t.name,
            "blocks": len(t.variables[0].values),
            "opening": t.opening._asdict(),
            **{
                key: [put(c) for c in getattr(t, key)] for key in ("variables", "before", "effects")
            },
        }
        for t in tables
    ]
    return b"".join(pieces), layout


def quantised(values: Float[np.ndarray, " block"]) -> tuple[np.ndarray, float, float]:
    """Values as whole numbers n with value = low + step n, n below 65536."""
    low, high = float(values.min()), float(values.max())
    step = (high - low) / LEVELS or 1.0
    return np.rint((values - low) / step).astype(np.uint16), low, step


def _compressed(content: bytes) -> str:
    # The time of compression is left out, so that the same residuals make the same file.
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()
