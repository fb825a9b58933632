"""The published pressure tables where they are at hand: in the folder BEAMRIDER_REFERENCE or in ../shared/reference."""

import os
from functools import lru_cache
from pathlib import Path

import pytest

from optics.table.pressure_table import PressureTable
from workflow import published_tables as published

ROOT = Path(__file__).resolve().parents[2]


def data_file() -> Path:
    """Where the published tables lie, or would lie."""
    return Path(os.environ.get("BEAMRIDER_REFERENCE") or ROOT.parent / "shared" / "reference") / published.NAME


needs_reference = pytest.mark.skipif(not data_file().exists(), reason="the published pressure tables are not at hand")


@lru_cache(maxsize=2)
def published_table(cell: str) -> PressureTable:
    """The published table of 'TE' or 'TM'."""
    return published.published_table(data_file(), cell)


def published_tables() -> dict[str, PressureTable]:
    """Both tables by design."""
    return {published.DESIGN[cell]: published_table(cell) for cell in published.DESIGN}
