"""A calibration as a figure, which a later folder draws.

It is named here by its place and not imported: a calibration is what figures are made of, and who asks for none need
not wait for matplotlib. `tests/test_import_order.py` holds the list of such names.
"""

import importlib
from typing import Any


DRAWN_BY = ("inertiax.plots.calibration", "both_triads")


def figure(calibration: Any) -> Any:
    """The matplotlib `Figure` of a calibration."""
    module, name = DRAWN_BY
    return getattr(importlib.import_module(module), name)(calibration)
