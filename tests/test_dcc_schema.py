"""Certificates of all kinds against PTB's schema, where it is at hand."""

import msgspec
import pytest

from dcc_schema import assert_valid, needs_schema
from inertiax.protocol.dcc import dcc
from inertiax.protocol.requirements import Limit
from inertiax.protocol.station import StationTable
from protocol_effect_cases import effect, protocol, RECORD


DATED = msgspec.structs.replace(
    RECORD,
    conditions=msgspec.structs.replace(
        RECORD.conditions, begin="2026-01-29T23:00:00Z", end="2026-01-30T01:00:00Z"
    ),
)
# A limit that the value lies on is undecided, for which the schema has no word.
ON_THE_LIMIT = (Limit("gyro.bias", 2e-3, "2e-3 rad/s"),)
LAG = effect("thermal_lag", settings=(("time_constant", 310.0),), unit="1")

KINDS = {
    "with an effect": protocol(),
    "without effects": protocol(effects=()),
    "with a setting of unknown uncertainty": protocol(effects=(LAG,)),
    "without requirements": protocol(limits=()),
    "undecided": protocol(limits=ON_THE_LIMIT, effects=()),
    "nothing stated": protocol("", StationTable()),
    "dated by its recordings": protocol(record=DATED),
    "white space and signs in names": protocol(" A <1>\n\t& ü ", StationTable(name="  Hall\n C ")),
}


@needs_schema
@pytest.mark.parametrize("kind", KINDS)
def test_the_certificate_is_valid(kind):
    assert_valid(dcc(KINDS[kind]))


def test_the_undecided_kind_is_undecided():
    assert [r.decision for r in KINDS["undecided"].requirements] == ["undecided"]
