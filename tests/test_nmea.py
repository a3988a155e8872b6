"""Sentences of satellite receivers: refused alone, read past where an IMU speaks among them."""

import re

import pytest

from hand_log_data import draft
from inertiax.data.formats.nmea import refuse_satellites


# From NMEA 0183's examples, as receivers repeat them each second; `$PMTK` is a maker's own.
SECOND = """\
$GPGSV,3,1,11,03,03,111,00,04,15,270,00,06,01,010,00,13,06,292,00*74
$GPGSV,3,2,11,14,25,170,00,16,57,208,39,18,67,296,40,19,40,246,00*74
$GNGGA,{0},4916.45,N,12311.12,W,1,08,0.9,545.4,M,46.9,M,,*47
$GNGSA,A,3,04,05,,09,12,,,24,,,,,2.5,1.3,2.1*39
$GNRMC,{0},A,4916.45,N,12311.12,W,000.5,054.7,191194,020.3,E*68
$GNVTG,054.7,T,034.4,M,005.5,N,010.2,K*48
"""


def test_satellites_are_no_imu(tmp_path):
    """Azimuths and strengths of a public log's satellites were an IMU of 128 counts per g."""
    path = tmp_path / "log.txt"
    path.write_text("$PMTK010,001*2E\n" + "".join(SECOND.format(161503 + k) for k in range(50)))
    with pytest.raises(ValueError, match=re.escape("NMEA 0183: $GPGSV, $GNGGA, $GNGSA, $GNRMC")):
        draft(path)


def test_an_imu_among_them_is_left_to_the_columns():
    spoken = (
        b"$VNIMU,+0.1,-0.3,+0.6,-00.01,+00.02,-09.79,+0.001,-0.002,+0.003,+20.1,+101.3*5A\n" * 40
    )
    refuse_satellites((SECOND.format(161503).encode() + spoken) * 20, "log.txt")
    refuse_satellites(
        b"$PASHR,130533.620,0.311,T,-80.467,-1.395,,0.066,0.067,0.215,2,3*0B\n" * 20, "log.txt"
    )
