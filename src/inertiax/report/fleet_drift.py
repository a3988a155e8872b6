"""What changed since an earlier run over the same devices, for the page over a fleet."""

from pathlib import Path

import numpy as np

from ..calibrate.fit_quality import TRIAD_NAMES
from ..calibration.quantities import label, with_sigma
from ..fleet.overview.recalibration import Drift, FAR
from ..fleet.overview.view import TriadView
from ..plots import fleet as plots
from ..plots.style import drawing
from .fleet_device import line_units, signed
from .page import picture, Section, Table


BY_CHANCE = 0.0027  # of normal changes are beyond 3 sigma
NAMED = 10  # devices in a sentence
LISTED = 100  # changes in a table


def drift_sentence(triad: str, drift: Drift) -> str:
    """How many devices were compared, and how many changes are far out."""
    count, beyond = drift.change.size, int((np.abs(drift.sigmas) > FAR).sum())
    expected = BY_CHANCE * count
    by_chance = f"about {expected:.0f}" if expected >= 1.0 else "hardly any"
    devices = len(drift.devices)
    before = f"{devices} device{'s were' if devices != 1 else ' was'} calibrated before"
    said = (
        f"{TRIAD_NAMES[triad]}: {before}; {beyond} of {count} changes are beyond {FAR:g} sigma, where chance alone "
        f"gives {by_chance}."
    )
    if drift.extrapolated and drift.covered is not None:
        at = ", ".join(f"{t:g}" for t in drift.extrapolated)
        low, high = drift.covered
        both = f"{low:.4g} to {high:.4g} °C" if low <= high else "no temperature in common"
        said += f" At {at} °C curves go on beyond what both runs cover, {both}."
    if drift.taken_for:
        pairs = ", ".join(f"{new} as {old}" for new, old in drift.taken_for[:NAMED])
        more = ", …" if len(drift.taken_for) > NAMED else ""
        said += (
            f" Read now as another did before (serial numbers or files exchanged?): {pairs}{more}."
        )
    return said


def beyond_chance(drift: Drift) -> bool:
    """Whether more changes are far out than chance gives; a device's temperatures move together."""
    expected = BY_CHANCE * drift.change.size
    far = int((np.abs(drift.sigmas) > FAR).sum())
    return bool(far > expected + 4.0 * np.sqrt(len(drift.temperatures) * expected) + 1.0)


def drift_section(
    triad: str, drift: Drift, view: TriadView, folder: Path, *, informed: bool
) -> Section:
    """Changes common to the line, and those of single devices; `informed`: calibrated with a prior."""
    units = line_units(view.model, view.mean[view.reference])
    temperatures = ", ".join(f"{t:g}" for t in drift.temperatures)
    caption = f"{TRIAD_NAMES[triad]}: all changes since the earlier run; curve: chance alone."
    with drawing():
        figure = plots.drift_sigmas(drift)
        shown = picture(figure, folder, f"fleet-{triad}-drift", caption, caption)
    lines = [drift_sentence(triad, drift), f"Compared at {temperatures} °C."]
    if informed:
        lines.append(
            "Estimates with a prior are drawn to its mean, and with them the changes to zero."
        )
    return Section(
        f"{TRIAD_NAMES[triad]}: drift since the earlier run",
        lines=tuple(lines),
        tables=(_common_table(drift, units), _far_table(drift, units)),
        figures=(shown,),
    )


def _common_table(drift: Drift, units: plots.Units) -> Table:
    """What all devices have in common: a change of the line, the rig or the reference."""
    rows = []
    for k, (name, (factor, unit)) in enumerate(zip(drift.names, units, strict=True)):
        change = factor * drift.change[:, :, k]
        common = np.median(change, axis=0)
        spread = 1.4826 * np.median(np.abs(change - common), axis=0)
        if len(change) == 1:  # one device has no spread, but its own uncertainty
            spread = factor * drift.sigma[0, :, k]
        cells = (" ± ".join(with_sigma(float(c), float(s))) for c, s in zip(common, spread))
        rows.append((label(name), unit, *cells))
    head = ("parameter", "unit", *(f"{t:g} °C" for t in drift.temperatures))
    caption = "Median change over the devices ± its spread between them."
    if len(drift.devices) == 1:
        caption = "Change ± its standard deviation, by both uncertainties together."
    return Table(head, tuple(rows), numeric=tuple(range(2, len(head))), caption=caption)


def _far_table(drift: Drift, units: plots.Units) -> Table:
    sigmas = drift.sigmas
    far = np.argwhere(np.abs(sigmas) > FAR)
    order = np.argsort(-np.abs(sigmas[tuple(far.T)]))[:LISTED]
    rows = []
    for d, t, k in far[order]:
        factor, unit = units[k]
        change, sigma = (
            with_sigma(float(factor * v[d, t, k]), float(factor * drift.sigma[d, t, k]))
            for v in (drift.change, drift.sigma)
        )
        rows.append(
            (
                drift.devices[d],
                label(drift.names[k]),
                f"{drift.temperatures[t]:g} °C",
                f"{change[0]} ± {sigma[1]}",
                unit,
                signed(float(sigmas[d, t, k])),
            )
        )
    caption = f"Changes beyond {FAR:g} sigma of both uncertainties together"
    caption += f", the {LISTED} greatest of {len(far)}." if len(far) > LISTED else "."
    head = ("device", "parameter", "at", "change", "unit", "sigmas")
    return Table(head, tuple(rows), numeric=(3, 5), caption=caption)
