"""What a person reads of a live session: names and units of `calibrate`'s table, where to turn after every rest."""

import pytest

from inertiax.cli.live_lines import times, Words


START = {
    "event": "start",
    "target": "accel.bias=2 mg",
    "limits": {"accel.bias": 2e-3 * 9.80665},
    "usual_for": "consumer",
    "hold": 4.0,
}
NEXT = {
    "event": "next",
    "statement": "turn it",
    "gain": 0.2,
    "further": None,
    "provisional": False,
}
REST = {"event": "rest", "number": 1, "start": 0.0, "end": 4.0, "why": None, "left_out": []}


def progress(**worst):
    known = {"worst": "it", "ratio": 268.4, "lacking": None, "parameters": {"it": worst}}
    return {"event": "progress"} | known


@pytest.fixture
def said(capsys):
    words = Words(quiet=False)

    def lines(*events):
        capsys.readouterr()
        for event in events:
            words(event)
        return capsys.readouterr().out.splitlines()

    return lines


def test_the_worst_parameter_is_said_in_the_unit_of_the_table(said):
    worst = {"value": -1.26e-3, "std": 9.9e-3, "unit": "1", "limit": 1e-3}
    shown = {"label": "misalignment zx of the accelerometers", "factor": 1e6, "shown_unit": "µrad"}
    line = "270 times the target; worst: misalignment zx of the accelerometers = -1300 ± 9900 µrad"
    assert said(progress(**worst, **shown)) == [f"{line} (target 1000)"]
    assert said(progress(**worst | {"limit": None}, **shown)) == [line]


@pytest.mark.parametrize(
    ("ratio", "text"), [(268.4, "270"), (0.957, "0.96"), (1.04, "1"), (3.1e7, "31000000")]
)
def test_ratios_have_no_exponent(ratio, text):
    assert times(ratio) == text


def test_a_statement_that_is_known_is_said_as_before(said):
    assert said(NEXT, REST | {"accepted": True}, NEXT) == [
        "next: turn it (gains 20 %)",
        "rest 1, 0.0 to 4.0 s: accepted",
        "next: as before: turn it (gains 20 %)",
    ]
    assert said(NEXT | {"statement": "anew", "gain": 0.0}) == ["next: anew"]
    assert said(NEXT | {"further": 7}) == ["next: turn it (gains 20 %, about 7 rests to go)"]
    assert said(NEXT | {"further": 1}) == [
        "next: as before: turn it (gains 20 %, about 1 rest to go)"
    ]


def test_a_first_rest_that_is_refused_says_what_to_do(said):
    refused = REST | {"accepted": False, "why": "held by hand"}
    assert said(refused)[0].endswith("held by hand; lay the device down again and leave it alone")
    assert said(NEXT, refused)[1].endswith("refused: held by hand")


def test_the_start_says_whose_target_it_is_and_what_is_not_asked(said):
    (usual,) = said(START)
    assert usual.startswith("target: accel.bias=2 mg (usual for grade consumer; others are set by")
    assert "; nothing is asked of the gyros. Lay the device down" in usual
    limits = {"accel.bias": 1.0, "gyro.bias": 1.0}
    (own,) = said(START | {"usual_for": None, "limits": limits})
    assert (
        own
        == "target: accel.bias=2 mg. Lay the device down and leave it alone until the bell, 6 s."
    )
    (run,) = said(START | {"usual_for": None, "limits": {}, "target": "a long rest"})
    assert run == "run: a long rest. There is no target: the steps below are the whole of it."


def test_an_error_says_to_go_on_and_is_said_again_at_the_end(said):
    wrong = {
        "kind": "accel_unit",
        "severity": "error",
        "statement": "1 g reads 9.8",
        "remedy": None,
    }
    done = {"event": "done", "reason": "target reached", "rests": 15, "seconds": 116.2}
    first, last = said({"event": "problem"} | wrong, done)
    assert "Go on: rows are kept as they came" in first and last.endswith("mended: 1 g reads 9.8")


def test_an_error_that_is_withdrawn_is_not_said_again_at_the_end(said):
    wrong = {
        "kind": "accel_unit",
        "severity": "error",
        "statement": "1 g reads 0.4",
        "remedy": None,
    }
    back = {
        "kind": "accel_unit",
        "severity": "note",
        "statement": "no longer found",
        "remedy": None,
    }
    done = {"event": "done", "reason": "input ended", "rests": 3, "seconds": 20.0}
    again = {"event": "problem"} | wrong
    _, note, last = said(again, {"event": "problem", "withdraws": "1 g reads 0.4"} | back, done)
    assert note == "note: no longer found" and last == "done: input ended after 20 s and 3 rests"
    assert said(again, done)[1].endswith("still to be mended: 1 g reads 0.4")


def test_a_rest_that_does_no_step_and_a_target_that_is_not_checked_are_said(said):
    rest = REST | {"accepted": True, "uncounted": "does not count for step 1: 90° off"}
    assert said(rest) == [
        "rest 1, 0.0 to 4.0 s: accepted, but it does not count for step 1: 90° off"
    ]
    shown = {"label": "bias x", "factor": 1.0, "shown_unit": "m/s²", "value": 0.1, "std": 0.01}
    met = progress(**shown | {"limit": 0.1}) | {"ratio": 0.1, "lacking": "5 further rests check it"}
    (line,) = said(met)
    assert line.startswith("0.1 times the target, but 5 further rests check it; worst: bias x = ")


@pytest.mark.parametrize("reason", ["target reached", "nothing more to gain"])
def test_an_end_before_the_inputs_says_that_the_rest_is_not_read(said, reason):
    done = {"event": "done", "reason": reason, "rests": 15, "seconds": 116.2}
    assert said(done) == [f"done: {reason} after 116 s and 15 rests; what comes after is not read"]
    assert said(done | {"reason": "input ended"}) == ["done: input ended after 116 s and 15 rests"]
