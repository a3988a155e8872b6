"""A part of the biases' temperature dependence that is late: what a diagnosis without the whole lag says of it.

A package may follow the probe at once and a stressed part of it minutes later. A lag of the element delays all
parameters alike and does not fit then; with $T_s$ behind the probe $T_p$ by a time constant τ the means of dwells are

$$\\bar y_n = \\sum_k T_k(x(\\bar T_{p,n})) \\, J_n \\, \\theta_k + \\beta \\, (\\bar T_{s,n} - \\bar T_{p,n}),$$

linear in the parameters θ and the late slope β of each τ. It is measured and no name: what else changes with a ramp of
temperature, and stays behind it, looks alike. Beside names it is said where it fits better than all of them together.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..effects import Variant
from .candidates.signatures import Term
from .estimates.augmented_calibration import Beside
from .late_elements import Chain, chains_of, element_at_dwells, LAG, means_of_dwells, STRONG, WORTH
from .problem import Prepared, Problem
from .result import Diagnosis


FINER = 33  # time constants between two of the grid's neighbours
SURE = 5.0  # standard deviations of a late slope: a chance of 6e-7, of some hundred that are tried
SIZES = {"accel": (1e3 / 9.80665, "mg/°C"), "gyro": (3600.0 * 180.0 / np.pi, "°/h/°C")}


class _Late(NamedTuple):
    """Least squares of one chain at one time constant."""

    left: float
    slope: Float[np.ndarray, " column"]  # of what stands beside the curves; late, SI per °C
    std: Float[np.ndarray, " column"]


def with_part_late(found: Diagnosis, problem: Problem, named: Sequence[Beside] = ()) -> Diagnosis:
    """The diagnosis with a sentence on each channel whose bias has a late part that fits better than what is `named`;
    as it is without such."""
    # What was named may have been found without some rests: its columns have those rows alone.
    beside = {b.prepared.form.triad: b for b in named}
    said = [
        sentence
        for prepared in problem.triads
        for mine in [beside.get(prepared.form.triad)]
        for sentence in (_said(mine.prepared, mine.terms) if mine else _said(prepared, ()))
    ]
    if not said:
        return found
    return replace(found, summary=f"{found.summary} {' '.join(said)}", notes=(*found.notes, *said))


def _said(prepared: Prepared, named: Sequence[Term]) -> list[str]:
    signal, blocks, form = prepared.signal, prepared.blocks, prepared.form
    lag_is_named = any(t.name == LAG.name for t in named)
    if signal.temperature is None or signal.at_temperature is None or lag_is_named:
        return []
    place = np.unique(blocks.dwell, return_inverse=True)[1]
    probe = means_of_dwells(blocks.mean(np.asarray(signal.temperature)), place)
    span = max(float(np.ptp(probe)), 1e-9)
    basis = np.polynomial.chebyshev.chebvander(
        2.0 * (probe - probe.min()) / span - 1.0, form.degree
    )

    def late_by(constant: float) -> np.ndarray:
        element, _ = element_at_dwells(prepared, place, Variant("", {"time_constant": constant}))
        return element - probe

    grid = [float(v.settings["time_constant"]) for v in LAG.variants(signal)]
    behind = {constant: late_by(constant) for constant in grid}
    made = []
    for number, chain in enumerate(chains_of(prepared, place)):
        mine = [t.columns[t.chains.index(number)] for t in named if number in t.chains]
        columns = np.concatenate([np.zeros((blocks.num_blocks, 0)), *mine], axis=1)
        plain = _fit(chain, basis, np.zeros((len(probe), 0)))
        beside = _fit(chain, basis, means_of_dwells(columns, place))
        if plain is None or beside is None:
            continue
        tried = {tau: fit for tau in grid if (fit := _fit(chain, basis, behind[tau])) is not None}
        if not tried:
            continue
        k = grid.index(min(tried, key=lambda tau: tried[tau].left))
        if not 0 < k < len(grid) - 1:
            continue
        for tau in np.geomspace(grid[k - 1], grid[k + 1], FINER):
            fit = _fit(chain, basis, late_by(float(tau)))
            if fit is not None:
                tried[float(tau)] = fit
        tau = min(tried, key=lambda tau: tried[tau].left)
        if tried[tau].left > STRONG * plain.left or not _pays(beside, tried[tau], len(probe)):
            continue
        # Slopes and time constant move together: with the change by ln τ beside them, each has the error of both.
        change = (late_by(1.01 * tau) - late_by(tau)) / np.log(1.01)
        by_slope, by_tau = (
            chain.bias * late_by(tau)[:, None],
            chain.bias @ tried[tau].slope * change,
        )
        both = _fit(chain, basis, np.column_stack([by_slope, by_tau]))
        made += [] if both is None else _sentences(form.triad, chain, tau, both)
    return made


def _pays(named: _Late, late: _Late, rows: int) -> bool:
    """Whether the late part is worth its slopes and time constant, against those of what was named, if anything was."""
    gain = rows * np.log(named.left / max(late.left, 1e-300))
    return bool(gain - (len(late.slope) + 1 - len(named.slope)) * np.log(rows) > WORTH)


def _sentences(triad: str, chain: Chain, tau: float, late: _Late) -> list[str]:
    factor, unit = SIZES[triad]
    names = [name for name in chain.names if ".bias[" in name]
    return [
        f"Means of the dwells fit where a part of the bias of {triad}_{'xyz'[int(name[-2])]}, "
        f"{factor * slope:.3g} ± {factor * std:.2g} {unit}, follows the probe with a lag of {tau:.3g} ± "
        f"{tau * late.std[-1]:.2g} s, and all else that depends on temperature follows at once: to tell, two ramp "
        "rates with a soak between."
        for name, slope, std in zip(names, late.slope.tolist(), late.std.tolist(), strict=False)
        if abs(slope) > SURE * std
    ]


def _fit(
    chain: Chain, basis: Float[np.ndarray, "dwell size"], behind: Float[np.ndarray, "dwell *late"]
) -> _Late | None:
    """The chain with its parameters over the probe's temperature and late slopes of its biases, by `behind` in °C;
    `None` where rows are too few."""
    rows = len(chain.output)
    curves = (chain.jacobian[:, :, None] * basis[:, None, :]).reshape(rows, -1)
    parts = chain.bias * behind[:, None] if behind.ndim == 1 else behind
    design = np.concatenate([curves, parts], axis=1)
    if rows < 2 * design.shape[1]:
        return None
    size = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    inverse = np.linalg.pinv(design / size, rcond=1e-10)
    solution = inverse @ chain.output
    left = float(np.sum((chain.output - design / size @ solution) ** 2))
    spread = np.sqrt(left / (rows - design.shape[1]) * np.sum(inverse**2, axis=1))
    first = curves.shape[1]
    return _Late(left, (solution / size)[first:], (spread / size)[first:])
