"""Parquet files with a checksum, which stands between their data and their footer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow.parquet as pq

from beamrider.io.checksum import with_checksum
from beamrider.io.files import atomic, reading, require_whole

if TYPE_CHECKING:
    import pandas as pd

_END = 8  # bytes: length of the footer, and the name of the format (Parquet format, "File Format")


def write_parquet(path: str | Path, content: bytes) -> None:
    """Write the content of a Parquet file, atomically."""
    footer = int.from_bytes(content[-_END : 4 - _END], "little")
    with atomic(path) as temporary:
        temporary.write_bytes(with_checksum(content, len(content) - _END - footer))


def rows_of(path: str | Path) -> int:
    """Rows of a file; InputError where it is damaged or none."""
    require_whole(path)
    with reading(path, "a readable Parquet file"):
        return int(pq.read_metadata(path).num_rows)


def read_parquet(path: str | Path) -> pd.DataFrame:
    """Rows of a file; InputError where it is damaged or none."""
    import pandas as pd  # half a second, which most jobs need not spend

    require_whole(path)
    with reading(path, "a readable Parquet file"):
        return pd.read_parquet(path)
