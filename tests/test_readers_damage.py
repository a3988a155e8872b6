"""Damaged binary files are read or refused in one line, whatever was damaged, and nothing is printed."""

import random

import pytest
import scipy.io

from inertiax.data.formats import read_recordings
from readers_cases import made_up


h5py = pytest.importorskip("h5py", reason="inertiax[formats] is not installed")
for library in ("pyulog", "rosbags"):
    pytest.importorskip(library, reason="inertiax[formats] is not installed")

from readers_data import bag, dataflash, matlab_73, raw_log  # noqa: E402


def hdf5(path, data):
    with h5py.File(path, "w") as file:
        for name, values in data.items():
            file.create_dataset(name, data=values, compression="gzip")


WRITERS = {
    "a.h5": hdf5,
    "v5.mat": scipy.io.savemat,
    "v73.mat": matlab_73,
    "a.ulg": raw_log,
    "a.bin": dataflash,
    "a.bag": lambda path, data: bag(path, "ros1", data),
    "mcap": lambda path, data: bag(path, "mcap", data),
    "sqlite": lambda path, data: bag(path, "sqlite3", data),
}


def damaged(whole, chance):
    """Cut off somewhere, or up to thirty bytes changed, half of the time near the start."""
    if chance.random() < 0.5:
        return whole[: chance.randrange(1, len(whole))]
    content = bytearray(whole)
    end = len(content) if chance.random() < 0.5 else min(3000, len(content))
    for _ in range(chance.choice([1, 3, 30])):
        content[chance.randrange(end)] = chance.randrange(256)
    return bytes(content)


@pytest.mark.parametrize("name", WRITERS)
def test_damage_is_refused_in_one_line_or_harmless(tmp_path, capfd, name):
    path = tmp_path / name
    WRITERS[name](path, made_up(count=200))
    stored = path if path.is_file() else next(p for p in path.iterdir() if p.suffix != ".yaml")
    whole, chance = stored.read_bytes(), random.Random(7)
    refused = 0
    for _ in range(30):
        stored.write_bytes(damaged(whole, chance))
        try:
            read_recordings(path)
        except ValueError as error:
            refused += 1
            assert "\n" not in str(error) and len(str(error)) < 700 and name in str(error)
    assert refused > 0
    said = capfd.readouterr()
    assert said.out == "" and said.err == ""
