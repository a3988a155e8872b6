"""What is said of an effect where |f| does not tell which channel has it, and gyros did not either."""

from collections.abc import Sequence

from ..candidates.signatures import Term
from ..result import Explanation
from ..selection.verdict import Named


ChannelOdds = Sequence[tuple[str, float]]
PARTED_BY = (
    "the channel: gyros in the same log and smooth turns of some seconds between the rests, by which gravity's turn "
    "tells the direction of f, or a table that gives it; the name: "
)


def channel_odds(named: Named, term: Term) -> tuple[tuple[str, float], ...]:
    """The channels of a named term and those that may have it in its place, with odds; none where they are told."""
    if not named.elsewhere:
        return ()
    on = (term, *(c.term for c in named.elsewhere))
    shares = zip(on, named.odds_of_channels, strict=True)
    return tuple((", ".join(t.channel_names), float(w)) for t, w in shares)


def channels_said(odds: ChannelOdds) -> str:
    """The sentence on channels between which the data do not decide, behind others."""
    shares = ", ".join(f"{channel} {100 * share:.0f} %" for channel, share in odds)
    if not odds:
        return ""
    return f" Which channel has it this data does not tell ({shares}), so that it is not applied."


def not_applied(effect: Explanation) -> str:
    """That the written calibration is without an effect, and why; "" where its channels are told."""
    if not effect.channel_odds:
        return ""
    channels = [channel for channel, _ in effect.channel_odds]
    return (
        f"{effect.name} on {channels[0]} is not applied in calibration.json: the data do not tell whether "
        f"{' or '.join(channels)} has it, and taken away from a wrong one it would put the direction of f further off."
    )
