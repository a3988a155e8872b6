"""Events of a live session as lines of text, with the names and units of `calibrate`'s table."""

import sys

from . import console


ENDS = 2.0  # s of a rest, a window of the finder, that do not count: the bell comes so much later


class Words:
    """Called with each event; prints what a person should read of it."""

    def __init__(self, *, quiet: bool):
        self._quiet = quiet
        self._last = ""
        self._errors: list[str] = []

    def __call__(self, event: dict) -> None:
        """A line for an event, or none."""
        made = getattr(self, f"_{event['event']}")(event)
        if event["event"] == "next":
            self._last = event["statement"]
        if made and not self._quiet:
            console.say(console.one_line(made))
            sys.stdout.flush()

    def _start(self, event: dict) -> str:
        if not event["limits"]:
            return (
                f"run: {event['target']}. There is no target: the steps below are the whole of it."
            )
        bell = event["hold"] + ENDS
        return f"target: {_asked(event)}. Lay the device down and leave it alone until the bell, {bell:g} s."

    def _rest(self, event: dict) -> str:
        when = f"rest {event['number']}, {event['start']:.1f} to {event['end']:.1f} s"
        if not event["accepted"]:
            again = "" if self._last else "; lay the device down again and leave it alone"
            return f"{when}: refused: {event['why']}{again}"
        out = [f"{d['kind']} at {d['start']:.1f} s" for d in event["left_out"]]
        but = f", but it {event['uncounted']}" if event.get("uncounted") else ""
        for_what = (
            " for the length of the force alone, since a hand held it" if event.get("held") else ""
        )
        return f"{when}: accepted{for_what}" + (f", without {', '.join(out)}" if out else "") + but

    def _problem(self, event: dict) -> str:
        remedy = f" Into campaign.toml: {event['remedy']}" if event["remedy"] else ""
        on = ""
        if event.get("withdraws") in self._errors:
            self._errors.remove(event["withdraws"])
        if event["severity"] == "error":
            self._errors.append(event["statement"])
            on = " Go on: rows are kept as they came, so mend campaign.toml afterwards."
        return f"{event['severity']}: {event['statement']}{remedy}{on}"

    def _progress(self, event: dict) -> str:
        if event["worst"] is None:
            return ""
        worst = _stated(event["parameters"][event["worst"]])
        but = f", but {event['lacking']}" if event["ratio"] <= 1.0 and event["lacking"] else ""
        return f"{times(event['ratio'])} times the target{but}; worst: {worst}"

    def _next(self, event: dict) -> str:
        known = event["statement"] == self._last and not event["provisional"]
        told = [f"gains {100 * event['gain']:.0f} %"] if event["gain"] > 0.0 else []
        if (further := event["further"]) is not None:
            told.append(f"about {further} rest{'s' * (further != 1)} to go")
        aside = f" ({', '.join(told)})" if told else ""
        return f"next: {'as before: ' if known else ''}{event['statement']}{aside}"

    def _done(self, event: dict) -> str:
        said = f"done: {event['reason']} after {event['seconds']:.0f} s and {event['rests']} rests"
        said += "" if event["reason"] == "input ended" else "; what comes after is not read"
        return said + "".join(f"; still to be mended: {error}" for error in self._errors)


def times(ratio: float) -> str:
    """A ratio to two digits, without an exponent."""
    return f"{float(f'{ratio:.2g}'):.15g}"


def _asked(event: dict) -> str:
    """The target, whose it is and how to set another one, and the triads of which it asks nothing."""
    from ..live.estimate import TRIADS

    said, limits = event["target"], event["limits"]
    if event["usual_for"] is not None:
        said += (
            f" (usual for grade {event['usual_for']}; others are set by --target, such as "
            '"accel.bias=1 mg, gyro.bias=0.1 deg/s, gyro.scale=3000 ppm")'
        )
    free = [t for t in TRIADS if limits and not any(n.startswith(f"{t}.") for n in limits)]
    return said + "".join(f"; nothing is asked of the {TRIADS[triad]}" for triad in free)


def _stated(found: dict) -> str:
    """A parameter in words: value, one sigma and limit in the unit of `calibrate`'s table."""
    from ..calibration.quantities import with_sigma

    factor, unit = found["factor"], found["shown_unit"]
    value, sigma = with_sigma(factor * found["value"], factor * found["std"])
    said = f"{found['label']} = {value} ± {sigma} {unit}"
    return said if found["limit"] is None else f"{said} (target {factor * found['limit']:.4g})"
