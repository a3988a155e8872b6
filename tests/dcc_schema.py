"""PTB's schema of a Digital Calibration Certificate, where the environment names the folder that holds it."""

import os
from pathlib import Path

import pytest


FOLDER = os.environ.get("INERTIAX_DCC_SCHEMA", "")
needs_schema = pytest.mark.skipif(
    not FOLDER, reason="INERTIAX_DCC_SCHEMA names no folder with dcc.xsd 3.1.2"
)


def assert_valid(certificate: bytes) -> None:
    """Raise where a certificate is not as the schema wants it."""
    from lxml import etree

    etree.XMLSchema(etree.parse(Path(FOLDER) / "dcc.xsd")).assertValid(
        etree.fromstring(certificate)
    )
