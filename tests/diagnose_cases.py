"""Candidates and scores of effects, as a search makes them."""

from dataclasses import replace

import numpy as np

from inertiax.diagnose.candidates.signatures import Term
from inertiax.diagnose.selection.evidence import Candidate
from inertiax.diagnose.selection.score_test import Score
from inertiax.effects import CATALOGUE, Variant


def candidate(name, evidence, ratio=0.0):
    """A candidate on gyro x: an effect of the catalogue, or an unlisted dependence."""
    effect = next((e for e in CATALOGUE if e.name == name), None)
    made = score(np.ones(5), name, 0)
    term = replace(made.term, triad="gyro", chains=(0,), effect=effect)
    return Candidate(term, replace(made, term=term), ratio, evidence)


def score(column, name, channel):
    """A one-column score of unit length on one chain."""
    unit = column / np.linalg.norm(column)
    term = Term(name, "accel", (channel,), Variant("", {}), (0,), (unit[:, None],))
    return Score(term, (0,), (unit[:, None],), np.ones((1, 1)), np.zeros(1), 0.0)
