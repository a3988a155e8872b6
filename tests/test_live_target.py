"""What a live target means: names, units, and one line about what is wrong."""

import math

import pytest

from inertiax.live.target import parse_target, USUAL, usual_target


@pytest.mark.parametrize(
    ("text", "parameter", "limit"),
    [
        ("accel.bias=0.3 mg", "accel.bias[1]", 0.3e-3 * 9.80665),
        ("accel.bias = 3e-3 m/s^2", "accel.bias[0]", 3e-3),
        ("accel.scale=200 ppm", "accel.matrix[2,2]", 2e-4),
        ("accel.misalignment=20 arcsec", "accel.matrix[2,1]", 20 * 4.84813681109536e-6),
        ("accel.matrix=0.1 %", "accel.matrix[1,0]", 1e-3),
        ("gyro.bias=10 deg/h", "gyro.bias[2]", 4.84813681109536e-5),
        ("gyro.bias=0.1 deg/s", "gyro.bias[2]", 1.7453292519943296e-3),
        ("gyro.matrix[2,1]=0.05deg", "gyro.matrix[2,1]", 8.726646259971648e-4),
        ("accel.bias[0]=1 mg, accel.matrix[1,0]=1 mrad", "accel.matrix[1,0]", 1e-3),
    ],
)
def test_a_limit_with_its_unit_is_taken_to_si(text, parameter, limit):
    assert math.isclose(parse_target(text).limit(parameter), limit, rel_tol=1e-12)


def test_what_is_not_named_has_no_limit_and_the_last_word_counts():
    target = parse_target("accel.scale=200 ppm, accel.matrix[0,0]=50 ppm")
    assert target.limit("accel.bias[0]") is None and target.limit("accel.matrix[1,0]") is None
    assert target.limit("accel.matrix[0,0]") == pytest.approx(5e-5)
    assert target.limit("accel.matrix[1,1]") == pytest.approx(2e-4)
    assert target.limit("gyro.bias[0]") is None


def test_where_nobody_asks_the_target_is_that_of_the_grade():
    assert (
        usual_target(None).usual_for == "consumer"
        and parse_target("accel.bias=1 g").usual_for is None
    )
    for grade in USUAL:
        found = usual_target(grade)
        assert found.usual_for == grade and {n.split(".")[0] for n, _ in found.limits} == {"accel"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("accel.bias", 'target "accel.bias": write a name'),
        ("accel.bais=1 mg", "did you mean 'accel.bias'?"),
        ("accel.bias=1 ppm", "unit 'ppm' does not belong to accel.bias"),
        ("accel.scale=1 mg", "unit 'mg' does not belong to accel.scale"),
        ("accel.bias=1", "no number with a unit"),
        ("accel.bias=-1 mg", "above 0"),
        ("accel.bias=0 mg", "above 0"),
        ("accel.bias=1e999 mg", "above 0"),
        ("accel.bias=1.2.3 mg", "above 0"),
        ("accel.bias=1 mg,", "write a name"),
        ("", "write a name"),
        ("accel.bias[3]=1 mg", "is no parameter"),
        ("accel.g_sensitivity=1 deg/h/g", "is no parameter"),
        ("gyro.g_sensitivity=10 deg/h/g", "rests alone do not tell it"),
        ("gyro.g_sensitivity=1 deg/h", "unit 'deg/h' does not belong to gyro.g_sensitivity"),
    ],
)
def test_a_target_that_is_not_understood_is_one_line(text, said):
    with pytest.raises(ValueError, match="target") as caught:
        parse_target(text)
    assert said in str(caught.value) and "\n" not in str(caught.value)
