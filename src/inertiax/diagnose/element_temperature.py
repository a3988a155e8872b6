"""The fitted model at other temperatures than the probe's: of which parameters such outputs are made.

A calibration's own parameters hold what a lag has bent. Where better ones are known, signatures are made of those.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import cast, NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from .._jax import eqx
from .candidates.signatures import coarsen, Term
from .observations.model_rows import Baseline, CalibratedTriad, ModelForm
from .problem import Prepared, Problem, rebuilt


class Fitted(Protocol):
    """A fitted model's outputs at other temperatures: what a signal's `at_temperature` is in a diagnosis."""

    def with_parameters(self, base: Baseline, coefficients: np.ndarray) -> "Fitted":
        """The same for other parameters."""
        ...


def bilinear(term: Term) -> bool:
    """Whether the term's signature is made of the model's outputs."""
    return term.effect is not None and "at_temperature" in term.effect.requires


def about(
    prepared: Prepared,
    values: Float[np.ndarray, "parameter size"],
    ahead: Float[np.ndarray, " time"] | None = None,
) -> Prepared:
    """The triad with the model's outputs at other temperatures from these parameters, and elements that were so much
    ahead of a recorded past when the power came on, °C."""
    model = cast(Fitted, prepared.signal.at_temperature)
    signal = eqx.tree_at(
        lambda s: (s.at_temperature, s.ahead),
        prepared.signal,
        (model.with_parameters(prepared.system.base, values), ahead),
        is_leaf=lambda x: x is None,
    )
    return replace(prepared, signal=signal, coarse=coarsen(signal, prepared.blocks))


def warmer_by(prepared: Prepared, degrees: float) -> Prepared:
    """The triad with elements that were warmer by so much after every pause, °C."""
    ahead = np.asarray(prepared.signal.ahead) + degrees
    signal = eqx.tree_at(lambda s: s.ahead, prepared.signal, ahead)
    return replace(prepared, signal=signal, coarse=coarsen(signal, prepared.blocks))


class Curves(NamedTuple):
    """Chebyshev coefficients of a triad's parameters over a range of temperatures, °C."""

    low: float
    high: float
    coefficients: Float[np.ndarray, "parameter size"]

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return self.coefficients.shape[1] - 1

    def over(self, form: ModelForm) -> Float[np.ndarray, "parameter size"]:
        """The same curves over the range of a form, and of its degree, which is no lower."""
        made = np.zeros((len(self.coefficients), form.degree + 1))
        for row, values in zip(made, self.coefficients):
            curve = np.polynomial.Chebyshev(values, domain=[self.low, self.high])
            row[: len(values)] = curve.convert(domain=[form.low, form.high]).coef
        return made


def curves_of(model: CalibratedTriad) -> Curves:
    """Those of a calibrated triad."""
    return Curves(model.form.low, model.form.high, model.coefficients)


def searched_about(prepared: Prepared, curves: Curves | None) -> Prepared:
    """The triad with candidates whose signature holds the model's parameters made of these ones.

    The triad as it is where there are none, or they are of another model.
    """
    form = prepared.form
    if curves is None or prepared.signal.at_temperature is None:
        return prepared
    parameters, size = curves.coefficients.shape
    if parameters != len(form.names) or size > form.degree + 1:
        return prepared
    made, only = about(prepared, curves.over(form)), prepared.only
    listed = tuple(rebuilt(made, t) if bilinear(t) else t for t in made.candidates)
    fewer = None if only is None else lambda kept: searched_about(only(kept), curves)
    return replace(made, candidates=listed, only=fewer)


def begun_at(problem: Problem, curves: Mapping[str, Curves]) -> Problem:
    """The problem with the candidates of these triads made so."""
    triads = (searched_about(p, curves.get(p.form.triad)) for p in problem.triads)
    return replace(problem, triads=tuple(triads))
