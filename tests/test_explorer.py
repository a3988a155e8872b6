"""The explorer's page: small, self-contained, and the numbers in it are the residuals."""

import base64
import gzip
import json
import re
import sys

import numpy as np
import pytest

from inertiax.diagnose.residuals import Residuals
from inertiax.report.explorer import quantised, write_explorer


def made(blocks, seed=0):
    """A gyro's residuals: white noise and a wave in temperature that was found."""
    rng = np.random.default_rng(seed)
    time = 2.0 * np.arange(blocks)
    temperature = 25.0 + 30.0 * np.sin(2.0 * np.pi * time / 20000.0)
    force = np.repeat(rng.standard_normal((blocks // 50 + 1, 3)), 50, axis=0)[:blocks]
    after = 1e-4 * rng.standard_normal((blocks, 3))
    return Residuals(
        triad="gyro", channels=("gyro_x", "gyro_y", "gyro_z"), time=1e6 + time,
        experiment=np.zeros(blocks, int), moving=np.zeros(blocks, bool),
        since_move=np.mod(time, 100.0), input=np.zeros((blocks, 3)), temperature=temperature,
        temperature_rate=np.gradient(temperature, time), force=force, rate=None,
        before=after + 3e-4 * np.sin(temperature / 10.0)[:, None], after=after,
    )  # fmt: skip


def read(text):
    """What a browser unpacks: the layout, and the 16-bit numbers as they are added up."""
    part = lambda name: re.search(rf'id="{name}">(.*?)</script>', text, re.S)[1]
    numbers = np.frombuffer(gzip.decompress(base64.b64decode(part("numbers"))), "<u2")
    return json.loads(part("layout")), numbers, gzip.decompress(base64.b64decode(part("library")))


def column(numbers, said, blocks):
    steps = np.cumsum(numbers[said["at"] : said["at"] + blocks].astype(np.uint64)) % 65536
    return said["low"] + said["step"] * steps


def test_the_page_holds_the_residuals_and_loads_nothing(tmp_path):
    rows = made(400)
    write_explorer([rows], tmp_path / "explorer.html", title="Residuals of <A-1>")
    text = (tmp_path / "explorer.html").read_text()
    ((triad,), numbers, library) = read(text)
    assert triad["triad"] == "gyro" and triad["blocks"] == 400
    seen = {c["name"]: column(numbers, c, 400) for c in triad["variables"]}
    # Half a step of 1/65535 of the range.
    np.testing.assert_allclose(seen["temperature"], rows.temperature, atol=60.0 / 65535)
    np.testing.assert_allclose(seen["time"], rows.time - rows.time[0], atol=800.0 / 65535)
    degrees_per_hour = np.rad2deg(1.0) * 3600.0
    for k, (before, effect) in enumerate(zip(triad["before"], triad["effects"], strict=True)):
        assert before["unit"] == "°/h"
        for said, values in ((before, rows.before), (effect, rows.before - rows.after)):
            there = column(numbers, said, 400)
            true = degrees_per_hour * values[:, k]
            np.testing.assert_allclose(there, true, atol=np.ptp(true) / 65535)
    assert b"Bokeh" in library
    assert "default-src 'none'" in text and not re.search(r'(?:src|href)="', text)
    assert "&lt;A-1&gt;" in text and "<A-1>" not in text


def test_a_hundred_thousand_points_take_less_than_a_megabyte_and_a_half(tmp_path):
    write_explorer([made(33_333)], tmp_path / "explorer.html", title="Residuals")
    assert (tmp_path / "explorer.html").stat().st_size <= 1.5e6


def test_of_more_points_an_even_choice_is_shown(tmp_path):
    write_explorer([made(50_000)], tmp_path / "explorer.html", title="Residuals")
    (triad,), _, _ = read((tmp_path / "explorer.html").read_text())
    assert triad["blocks"] == 25_000


def test_a_column_of_one_value_is_kept():
    values, low, step = quantised(np.full(5, 3.25))
    assert low == 3.25 and step > 0.0 and not values.any()


def test_the_same_residuals_make_the_same_numbers(tmp_path):
    for name in ("a.html", "b.html"):
        write_explorer([made(300)], tmp_path / name, title="Residuals")
    first, second = (read((tmp_path / n).read_text())[:2] for n in ("a.html", "b.html"))
    assert first[0] == second[0] and np.array_equal(first[1], second[1])


def test_without_bokeh_the_cure_is_said_in_a_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "bokeh", None)
    with pytest.raises(ValueError, match=r"pip install 'inertiax\[explore\]'"):
        write_explorer([made(10)], tmp_path / "explorer.html", title="Residuals")
    assert not list(tmp_path.iterdir())


def test_the_page_opens_on_what_was_found_over_what_drives_it(tmp_path):
    def opening(rows):
        write_explorer(rows, tmp_path / "explorer.html", title="")
        layout, _, _ = read((tmp_path / "explorer.html").read_text())
        return [t["opening"] for t in layout]

    def with_(rows, **changes):
        return Residuals(**{k: getattr(rows, k) for k in rows.__dataclass_fields__} | changes)

    rows = made(3000)
    force = rows.force[:, 1]
    after = np.array(rows.after)
    found = after + np.outer(5e-4 * force**2, [0.0, 1.0, 0.0])
    position = np.arange(3000) // 50 % 7
    (told,) = opening([with_(rows, before=found, position=position)])
    assert (told["channel"], told["over"]) == ("gyro_y", "specific force y") and told["share"] > 0.5
    # Nothing found, and one position that is off.
    off = after + np.outer(4e-4 * (position == 3), [1.0, 0.0, 0.0])
    (told,) = opening([with_(rows, before=off, after=off, position=position)])
    assert (told["channel"], told["over"]) == ("gyro_x", "position")
    (told,) = opening([with_(rows, before=after, after=after)])  # noise alone
    assert (told["channel"], told["over"], told["share"]) == ("gyro_x", "temperature", 0.0)
