"""Whether further columns of a least squares are worth their number: Schwarz's criterion, exact where rows are few.

With a unit-information prior on q further coefficients (Zellner's g-prior with g = n), flat priors on the p that both
models have and on ln σ, and ρ the part of the residual squares that the further columns leave,

    ln B = ½ (ν − q) ln(1 + n) − ½ ν ln(1 + n ρ),    ν = n − p.

For n far beyond p + q this is half the difference of BIC = n ln(RSS/n) + k ln n. Where unknowns are about as many as
rows, ρ vanishes with the degrees of freedom and n ln ρ rewards that without bound; here it cannot win.

**Reference:** Liang, Paulo, Molina, Clyde, Berger, J. Am. Stat. Assoc. 103 (2008) 410, eq. 6; Kass, Wasserman, ibid. 90
(1995) 928, for the link to Schwarz's criterion.
"""

import math


def log_odds(rows: int, kept: int, further: int, left: float) -> float:
    """ln B of the model with the further columns, above zero where they are worth it.

    **Arguments:** numbers of rows, of unknowns that both models have, and of further ones; `left` is ρ, from 0 to 1.
    """
    freedom = rows - kept
    share = min(max(left, 0.0), 1.0)
    return 0.5 * ((freedom - further) * math.log1p(rows) - freedom * math.log1p(rows * share))
