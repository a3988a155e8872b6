"""That the fitted noise is not the noise within a rest: said with the answer, since every probability rests on it."""

from collections.abc import Sequence

from scipy.special import ndtri

from ..estimates.allan_check import AllanCheck


CHANCE = 0.01  # that any of the comparisons of a sound noise is called doubtful


def doubted(checks: Sequence[AllanCheck]) -> tuple[AllanCheck, ...]:
    """Of each channel the comparison that is farthest off, where chance does not make it so.

    As many comparisons are made as there are `checks` (Bonferroni).
    """
    if not checks:
        return ()
    limit = -float(ndtri(0.5 * CHANCE / len(checks)))
    worst: dict[str, AllanCheck] = {}
    for check in sorted(checks, key=lambda c: -abs(c.deviate)):
        if not check.agrees and abs(check.deviate) > limit:
            worst.setdefault(check.channel, check)
    return tuple(worst[name] for name in sorted(worst))


def noise_sentence(found: Sequence[AllanCheck]) -> str:
    """What is doubtful and what follows; an empty text where nothing is.

    **Arguments:** `found` are the `doubted` comparisons.
    """
    if not found:
        return ""
    each = ", ".join(
        f"{c.channel} {float(f'{c.expected / c.measured:.2g}'):g} times" for c in found
    )
    return (
        f"The fitted noise is not that within the longest rest: {each} its Allan deviation at {found[0].tau:.2g} s. "
        "Rests differ in their noise, where a step or a drift may hide; sizes and probabilities there do not hold."
    )
