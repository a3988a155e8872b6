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
NEXT = {"event": "next", "statement": "turn it", "gain": 0.2, "provisional": False}
REST = {"event": "rest", "number": 1, "start": 0.0, "end": 4.0, "why": None, "left_out": []}


def parameter(value, std, limit=None):
    return {"value": value, "std": std, "unit": "1", "limit": limit}


def progress(name, **parameters):
    return {"event": "progress", "worst": name, "ratio": 268.4, "parameters": parameters}


@pytest.fixture
def said(capsys):
    words = Words(quiet=False)

    def lines(*events):
        capsys.readouterr()
        for event in events:
            words(event)
        return capsys.readouterr().out.splitlines()

    return lines


@pytest.mark.parametrize(
    ("name", "found", "line"),
    [
        (
            "accel.matrix[2,0]",
            parameter(-0.00126, 0.0099, 1e-3),
            "misalignment zx of the accelerometers = -1300 ± 9900 µrad (target 1000)",
        ),
        (
            "accel.matrix[1,1]",
            parameter(0.01, 0.0012, 1e-3),
            "scale factor y of the accelerometers = 10000 ± 1200 ppm (target 1000)",
        ),
        (
            "accel.bias[0]",
            parameter(0.1, 0.02, 0.0196133),
            "bias x of the accelerometers = 0.100 ± 0.020 m/s² (target 0.01961)",
        ),
        # 1e-4 rad/s are 20.6 °/h; a bias of 0.01 rad/s, 2063 °/h, is told in °/s.
        (
            "gyro.bias[2]",
            parameter(1e-4, 1e-5),
            "bias z of the gyros = 20.6 ± 2.1 °/h",
        ),
        (
            "gyro.bias[1]",
            parameter(0.01, 1e-5),
            "bias y of the gyros = 0.57296 ± 0.00057 °/s",
        ),
    ],
)
def test_the_worst_parameter_has_name_and_unit_of_the_table(said, name, found, line):
    assert said(progress(name, **{name: found})) == [f"270 times the target; worst: {line}"]


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
    assert own == "target: accel.bias=2 mg. Lay the device down and leave it alone for 4 s."


@pytest.mark.parametrize("reason", ["target reached", "nothing more to gain"])
def test_an_end_before_the_inputs_says_that_the_rest_is_not_read(said, reason):
    done = {"event": "done", "reason": reason, "rests": 15, "seconds": 116.2}
    assert said(done) == [f"done: {reason} after 116 s and 15 rests; what comes after is not read"]
    assert said(done | {"reason": "input ended"}) == ["done: input ended after 116 s and 15 rests"]
