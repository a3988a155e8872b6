"""Every JSON document that we write is read by our own strict reader, or is not written, whatever its numbers are."""

import ast
from pathlib import Path

import msgspec
import numpy as np
import pytest
from scipy import special, stats

import inertiax
from inertiax.data.json_documents import decode, encode
from inertiax.effects import CATALOGUE, Signal
from inertiax.fleet.effects.population_effects import (
    _normal_deviate,
    Common,
    LineMismatch,
    read_line,
)
from inertiax.fleet.effects.score_statistics import FleetScores, Form, Term
from inertiax.fleet.overview.explain import LineFile, SCHEMA as LINE
from inertiax.fleet.population.population import Outlier
from inertiax.fleet.store import Manifest, read_manifest, SCHEMA as MANIFEST, write_manifest


TERM = Term("drift", "accel_x", "linear", "m/s^2", False)
NOT_FINITE = [float("inf"), float("-inf"), float("nan")]


class Sample(msgspec.Struct, forbid_unknown_fields=True):
    schema: str
    number: float
    many: list[float]
    perhaps: float | None = None


@pytest.mark.parametrize("number", [0.0, -0.0, 1e-320, 1.7976931348623157e308, 2.0, 1 / 3])
def test_numbers_come_back_bit_for_bit(number):
    document = Sample("s/1", number, [number])
    for indent in (None, 1):
        assert (
            decode(encode(document, "f", indent=indent), Sample, "f", "a sample", "s/1") == document
        )


@pytest.mark.parametrize("number", NOT_FINITE)
@pytest.mark.parametrize("place", ["number", "many"])
def test_a_number_that_json_has_not_is_told_before_the_file_is_written(number, place):
    values = {"number": 1.0, "many": [1.0]} | {place: number if place == "number" else [number]}
    with pytest.raises(ValueError, match=rf"^f\.json: not written, .*'{place}") as caught:
        encode(Sample("s/1", **values), "f.json")
    assert "\n" not in str(caught.value)


def test_every_typed_document_goes_through_the_one_writer():
    """A `Struct` that is read by `decode` is written by `encode`: no other module of those calls msgspec's."""
    home = Path(inertiax.__file__).parent
    readers = [f for f in home.rglob("*.py") if "import decode" in f.read_text("utf-8")]
    assert len(readers) >= 5
    for file in readers:
        called = {
            ast.unparse(n.func)
            for n in ast.walk(ast.parse(file.read_text("utf-8")))
            if isinstance(n, ast.Call)
        }
        assert "msgspec.json.encode" not in called, file


@pytest.mark.parametrize("number", NOT_FINITE)
def test_documents_of_a_fleet_refuse_numbers_that_are_not_finite(number):
    common = Common(TERM, 1.0, 0.1, 0.0, number, (), True)
    line = LineFile(LINE, (LineMismatch("accel", 9, (common,), ()),))
    for document in (line, Outlier("A", number, "accel.bias[0]", 0, 3.0)):
        with pytest.raises(ValueError, match="not written"):
            encode(document, "f")


def test_settings_of_every_effect_come_back_from_a_manifest_with_their_types(tmp_path):
    """A whole number that came back as a float could index nothing: `fleet --explain` a second time."""
    forms = tuple(
        Form(effect.name, variant.label, dict(variant.settings), 1)
        for effect in CATALOGUE
        for variant in effect.variants(signal())
    )
    assert {type(v) for f in forms for v in f.settings.values()} == {int, float, str}
    assert len(forms) > 40
    manifest = Manifest(MANIFEST, "mark", 9.8, None, None, False, (), (), forms={"accel": forms})
    write_manifest(manifest, tmp_path)
    back = read_manifest(tmp_path)
    assert back == manifest
    for given, got in zip(forms, back.forms["accel"], strict=True):
        assert {k: type(v) for k, v in got.settings.items()} == {
            k: type(v) for k, v in given.settings.items()
        }


def signal() -> Signal:
    """What a triad may go through in which every effect shows."""
    rng = np.random.default_rng(1)
    num = 400
    time = np.linspace(0.0, 4000.0, num)
    temperature = 20.0 + 15.0 * np.sin(time / 500.0)
    force = 9.8 * rng.standard_normal((num, 3))
    return Signal(
        triad="accel", time=time, input=force, output=force, since_power=time, since_start=time,
        since_move=time % 20.0, move=rng.standard_normal((num, 3)), at_rest=np.arange(num) % 2 == 0,
        temperature=temperature, temperature_rate=np.gradient(temperature, time), force=force,
        rate=rng.standard_normal((num, 3)), room=np.broadcast_to(np.eye(3), (num, 3, 3)),
        vibration=rng.random(num), resolution=np.full(3, 0.1), scatter=np.full(3, 0.01),
        supply=5.0 + 0.1 * rng.standard_normal(num), at_temperature=None, degree=3, low=5.0, high=35.0,
    )  # fmt: skip


@pytest.mark.parametrize("freedom", [7, 30, 899, 20_000])
@pytest.mark.parametrize("t", [0.5, 3.0, 12.0])
def test_the_normal_deviate_is_students_tail(freedom, t):
    """Against SciPy's distribution, in the part that double precision holds."""
    expected = stats.norm.isf(stats.t.sf(t, freedom))
    np.testing.assert_allclose(_normal_deviate(t, freedom), expected, rtol=1e-9)


@pytest.mark.parametrize(("freedom", "t"), [(899, 60.0), (2000, 80.0), (19_999, 1e3)])
def test_far_out_it_is_finite_and_right_to_three_digits(freedom, t):
    """log P(T > t) by the leading terms of the tail, for the density is known in closed form.

    P(T > t) = f(t) (t² + n) / (n t) (1 − …), and P(Z > z) = φ(z)/z (1 − 1/z² …).
    """
    n = float(freedom)
    log_f = special.gammaln((n + 1) / 2) - special.gammaln(n / 2) - 0.5 * np.log(n * np.pi)
    log_f -= (n + 1) / 2 * np.log1p(t * t / n)
    log_tail = log_f + np.log((t * t + n) / (n * t))
    z = _normal_deviate(t, freedom)
    assert np.isfinite(z)
    log_normal = -0.5 * z * z - np.log(z) - 0.5 * np.log(2 * np.pi)
    np.testing.assert_allclose(log_normal, log_tail, rtol=3e-3)


@pytest.mark.parametrize("agreement", [1e-6, 1e-12, 0.0])
def test_a_line_of_devices_that_agree_in_every_digit_is_written_and_read(agreement):
    """900 devices with the same effect: z was infinite, and the file could not be read."""
    rng = np.random.default_rng(5)
    amplitude = 1.0 + agreement * rng.standard_normal((900, 1))
    scores = FleetScores((TERM,), amplitude, np.full((900, 1), 1e-3), np.ones((1, 1)))
    found = read_line("accel", [f"d{k}" for k in range(900)], scores)
    assert found.common and np.isfinite(found.common[0].z) and found.common[0].z > 100.0
    document = LineFile(LINE, (found,))
    assert decode(encode(document, "line.json"), LineFile, "line.json", "a line", LINE) == document
