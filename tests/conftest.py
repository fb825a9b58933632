"""Fixtures that several tests use."""

from pathlib import Path

import pytest

from optics.cells import Metagrating, read_metagrating

DESIGNS = Path(__file__).parents[1] / "workflow" / "designs"


@pytest.fixture(scope="session")
def te() -> Metagrating:
    """The paper's TE cell."""
    return read_metagrating(DESIGNS / "mark1e_te.yaml")


@pytest.fixture(scope="session")
def tm() -> Metagrating:
    """The paper's TM cell."""
    return read_metagrating(DESIGNS / "mark1e_tm.yaml")
