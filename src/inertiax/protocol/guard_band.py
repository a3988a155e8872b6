"""Whether a value meets a limit: decisions with a guard band, so that few of them are wrong.

A value x with standard uncertainty u and ν degrees of freedom is to be within ±L. With w = t(1 − α; ν) u

    pass: |x| + w ≤ L,     fail: |x| − w > L,     else undecided.

Whatever the true value, a pass or a fail is wrong with a probability of at most α, because only one side can be:
at the limit itself it is α. For α = 2.5 % w is the expanded uncertainty of 95 %.

Several values (three axes, several temperatures) pass together when each passes alone, which is wrong no more often
than α: one that is outside had to pass. They fail when one fails at α / n, which bounds the chance that any of n
values inside fails (Bonferroni).

**References:** JCGM 106:2012, 8.3.2 (guarded acceptance) and 8.3.3 (guarded rejection); for the intersection-union test
Berger, *Technometrics* 24, 1982.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

from .expanded_uncertainty import quantile


RISK = 0.025  # α: the greatest probability that a pass, or a fail, is wrong

Decision = Literal["pass", "fail", "undecided"]


class Measured(NamedTuple):
    """A value with what is known of it."""

    value: float
    std: float
    degrees: float  # of freedom, of `std`; inf where it is known


def decide(
    accepted: Sequence[Measured], rejected: Sequence[Measured], limit: float, risk: float = RISK
) -> Decision:
    """The decision on values that all are to be within ±`limit`.

    **Arguments:** `accepted` must all pass for "pass"; one of `rejected`, which are fewer so that their allowance is
    smaller, must fail for "fail"; `limit` > 0 in the values' unit. Raises `ValueError` where there are no values.
    """
    if not accepted or not rejected:
        raise ValueError("`decide(...)`: there are no values to decide on.")
    if all(abs(m.value) + allowance(m, risk) <= limit for m in accepted):
        return "pass"
    shared = risk / len(rejected)
    if any(abs(m.value) - allowance(m, shared) > limit for m in rejected):
        return "fail"
    return "undecided"


def allowance(measured: Measured, risk: float = RISK) -> float:
    """w = t(1 − risk; ν) u, in the value's unit."""
    return quantile(1.0 - risk, measured.degrees) * measured.std
