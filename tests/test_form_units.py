"""Units of coefficients by form: dimensions by scaling the input, and sizes on the page beside hand values."""

import re
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest

from every_form import every_form, signal
from inertiax.calibration.effect_units import shown_parameter, shown_parameters
from inertiax.calibration.fitted_effects import EffectEntry, from_entry, to_entry
from inertiax.diagnose.result import Parameter
from inertiax.diagnose.wording.sentences import Said, sentence
from inertiax.effects import CATALOGUE
from inertiax.protocol import content
from inertiax.protocol.dcc import dcc
from protocol_effect_cases import effect, protocol


BY_NAME = {e.name: e for e in CATALOGUE}
DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"
# Homogeneous in what the triad feels; the others clip, round, look up, or have a coefficient of one by theory.
HOMOGENEOUS = """temperature_order temperature_dependence temperature_rate thermal_hysteresis drift settling warm_up
bias_step second_order third_order odd_quadratic scale_asymmetry cross_coupling rate_nonlinearity cross_axis_rate
table_misalignment pier_tilt gravity_error rate_scale_error supply interference""".split()
CASES = [c for c in every_form() if c[0].name in HOMOGENEOUS]
RAD = np.pi / 180.0  # in a degree
MISALIGNED = (("on", "misalignment"), ("terms", 1))


def power(triad: str, unit: str) -> int:
    """How often a coefficient's unit is divided by that of the input: the output's own unit lacking counts as once."""
    output, given = {"accel": ("m/s^2", r"/g"), "gyro": ("rad/s", r"/\(rad/s\)")}[triad]
    if not unit.startswith((output, f"({output})")):
        return 1
    found = re.search(given + r"(?:\^(\d))?", unit)
    return 0 if found is None else int(found[1] or 1)


@pytest.mark.parametrize(
    "known, triad, variant, columns",
    CASES,
    ids=lambda x: getattr(x, "name", getattr(x, "label", x)),
)
def test_a_coefficient_has_the_dimension_that_its_column_asks_for(known, triad, variant, columns):
    # Twice the input makes 2^p of a column whose coefficient is one of the output per input^p.
    degree = 0 if known.name == "temperature_dependence" else 3
    once = np.asarray(known.shape(signal(triad, degree), **variant.settings))
    twice = np.asarray(known.shape(signal(triad, degree, gain=2.0), **variant.settings))
    for k in range(columns):
        expected = 2.0 ** power(triad, known.unit(triad, variant.settings, k))
        scale = np.abs(once[..., k]).max()
        assert scale > 0.0
        np.testing.assert_allclose(twice[..., k], expected * once[..., k], atol=1e-12 * scale)


def test_the_rate_of_the_temperatures_rate_is_per_second_more():
    known = BY_NAME["temperature_rate"]
    settings = {"on": "gradient", "time_constant": 0.0}
    assert known.unit("gyro", settings, 0) == "rad/s/(degC/min)"
    assert known.unit("gyro", settings, 1) == "rad/s/(degC/min/s)"


def test_what_a_form_acts_on_is_said_and_its_coefficient_is_in_its_own_unit():
    known = BY_NAME["temperature_order"]
    said = {}
    for on, triad, value, std in (
        ("scale", "accel", 2.2188e-4, 6.1e-6),
        ("misalignment", "gyro", 8.933e-5, 2.05e-6),
        ("bias", "accel", 2.2188e-4, 6.1e-6),
    ):
        settings = {"on": on, "terms": 1}
        values = (("coefficient", Parameter(value, std, known.unit(triad, settings))),)
        member = Said((f"{triad}_z",), values, (("temperature_order", 1.0),))
        said[on] = sentence(known, settings, [member])
    # 2.2188e-4 of the scale factor are 221.9 ppm, as an acceleration they are 22.63 µg (9.80665e-6 m/s²).
    assert "acts on the scale factor" in said["scale"]
    assert "coefficient 221.9 ± 6.1 ppm" in said["scale"]
    assert "acts on the misalignments" in said["misalignment"]
    assert "coefficient 89.3 ± 2.0 µrad" in said["misalignment"]
    assert "acts on the bias" in said["bias"] and "coefficient 22.63 ± 0.62 µg" in said["bias"]


@pytest.mark.parametrize(
    "name, settings, triad, value, unit, shown",
    [
        # Hand values: 1e-9 of the scale factor in a second is 3.6 ppm in an hour; 1 °/h is 4.8481368e-6 rad/s.
        ("drift", {"on": "scale"}, "accel", 1e-9, "1/s", ("3.600", "ppm/h")),
        ("drift", {"on": "bias"}, "gyro", 4.8481368e-6 / 3600, "rad/s/s", ("1.000", "(°/h)/h")),
        ("temperature_rate", {"on": "scale"}, "gyro", 2e-5, "1/(degC/min)", ("20.00", "ppm/(°C/min)")),
        ("thermal_hysteresis", {"on": "scale", "loop": "play", "radius": 0.1}, "accel", 5e-5, "1", ("50.00", "ppm")),
        ("temperature_dependence", {"on": "misalignment", "terms": 1}, "accel", 3e-5, "rad", ("30.00", "µrad")),
        ("settling", {"size": "signed", "time_constant": 4.0}, "accel", 9.80665e-5, "m/s^2/g", ("10.00", "µg/g")),
        ("settling", {"size": "distance", "time_constant": 4.0}, "gyro", 1e-5, "(rad/s)/(rad/s)", ("10.00", "ppm")),
        # 1 (°/h)/(°/s)³ is 4.8481368e-6 rad/s over (π/180)³ (rad/s)³.
        ("rate_nonlinearity", {"power": 3}, "gyro", 4.8481368e-6 / RAD**3, "rad/s/(rad/s)^3", ("1.0", "(°/h)/(°/s)³")),
        ("cross_axis_rate", {"terms": "|p|"}, "gyro", 2e-5, "(rad/s)/(rad/s)", ("20.00", "ppm")),
        # 10 arcsec are 48.481368 µrad; the pier is the station's.
        ("pier_tilt", {"course": "linear"}, "accel", 48.481368e-6, "rad", ("10.00", "arcsec")),
    ],
)  # fmt: skip
def test_sizes_of_forms_in_the_units_of_data_sheets(name, settings, triad, value, unit, shown):
    assert BY_NAME[name].unit(triad, settings) == unit
    text, _, in_unit = shown_parameter(name, "coefficient", Parameter(value, None, unit))
    assert (float(text), in_unit) == (pytest.approx(float(shown[0]), rel=1e-3), shown[1])


def test_coefficients_of_an_effect_have_one_unit():
    """0.5 and 0.1 °/s/g: the smaller one alone is 360 °/h/g."""
    values = [
        (f"coefficient[{k}]", Parameter(v * RAD, None, "rad/s/g")) for k, v in enumerate((0.5, 0.1))
    ]
    rows = shown_parameters("g_sensitivity", values)
    assert [(value, unit) for _, value, _, unit in rows] == [("0.5", "°/s/g"), ("0.1", "°/s/g")]


def misaligned(unit: str):
    return effect(
        "temperature_order", settings=MISALIGNED, coefficients=np.array([8.933e-5, 1.9e-7]),
        covariance=np.diag([2.05e-6**2, 5.3e-7**2]), unit=unit, degree=1, scale=(-20.0, 60.0),
    )  # fmt: skip


@pytest.mark.parametrize("unit", ["rad", "rad/s"])
def test_a_protocol_states_a_misalignment_as_an_angle(unit):
    # Also of a result written when every form had the unit of that on the bias.
    made = protocol(effects=(misaligned(unit),))
    assert [e["unit"] for e in made.document()["effects"]] == ["rad", "rad"]
    section = content.effects(made)
    # 1.96 · 2.05 µrad are 4.0 µrad.
    assert section.tables[0].rows[0][3:] == ("89.3", "4.0", "µrad")
    assert "on the misalignments" in section.tables[0].rows[0][2]
    root = ElementTree.fromstring(dcc(made))
    quantities = [
        q for q in root.iter(f"{DCC}quantity")
        if "temperature_order" in (q.findtext(f"{DCC}name/{DCC}content") or "")
    ]  # fmt: skip
    assert [q.findtext(f"{SI}real/{SI}unit") for q in quantities] == [r"\radian", r"\radian"]
    assert float(quantities[0].findtext(f"{SI}real/{SI}value")) == pytest.approx(8.933e-5)


def test_a_file_has_the_unit_of_the_form_and_another_is_refused():
    entry = to_entry(misaligned("rad"))
    assert from_entry(entry, "file").unit == "rad"
    entry.unit = "rad/s"  # as it was written before; the number is the same
    assert from_entry(entry, "file").unit == "rad"
    entry.unit = "m"
    with pytest.raises(ValueError, match="unit is 'm'; it must be 'rad'"):
        from_entry(entry, "file")


def test_every_form_that_a_diagnosis_may_fit_is_read_back_from_its_file():
    """What is written as JSON is the same effect when it is read; settings that no form has are refused."""
    for known, triad, variant, columns in every_form():
        settings = tuple(sorted(variant.settings.items()))
        fitted = effect(
            known.name, triad=triad, settings=settings, coefficients=np.arange(1.0, columns + 1),
            covariance=np.eye(columns), unit=known.unit(triad, variant.settings),
        )  # fmt: skip
        text = msgspec.json.encode(to_entry(fitted))
        back = from_entry(msgspec.json.decode(text, type=EffectEntry), "file")
        assert (back.name, back.triad, back.channels) == (known.name, triad, fitted.channels)
        assert dict(back.settings) == dict(settings), (known.name, variant.label)
        np.testing.assert_array_equal(back.coefficients, fitted.coefficients)
        entry = to_entry(fitted)
        entry.settings = {**entry.settings, "colour": 1.0}
        with pytest.raises(ValueError, match="colour"):
            from_entry(entry, "file")


def test_the_asymmetry_is_half_the_difference_of_the_two_signs():
    # A scale factor of 100 ppm for positive and of 20 ppm for negative input: c = (100 − 20)/2 = 40 ppm.
    rate = np.linspace(-2.0, 2.0, 41)
    added = np.where(rate > 0.0, 100e-6, 20e-6) * rate
    design = np.column_stack([rate, np.abs(rate)])
    common, half = np.linalg.lstsq(design, added, rcond=None)[0]
    np.testing.assert_allclose([common, half], [60e-6, 40e-6], rtol=1e-12)
    equation = BY_NAME["scale_asymmetry"].equation
    assert equation.startswith("c |f| or c |w|; c = (K+ - K-)/2")
