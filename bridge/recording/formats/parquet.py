"""Reader and writer of Parquet files, by pyarrow (the extra `parquet`), with one column per axis, named as in a .csv.

Column names of other tools are recognised as in a text table.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import IO

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
import pyarrow.parquet as pq
from numpy.typing import NDArray

from bridge.recording.error import MAX_BYTES, RecordingError
from bridge.recording.reading import Reading
from bridge.recording.table import Table
from bridge.recording.text import reader


def read(path: Path, reading: Reading) -> Table:
    """Read the numeric and time columns of a Parquet file as a Table, in SI units.

    Columns are recognised by their names, as those of a text table. Raises RecordingError for a file that is damaged,
    too large or without the needed columns.
    """
    # A dataset reads only the columns named; ParquetFile reads also a text of the same name, or within one of that name.
    file = ds.dataset(path, format="parquet")
    wanted = [
        one.name
        for one in file.schema
        if pa.types.is_timestamp(one.type) or pa.types.is_integer(one.type) or pa.types.is_floating(one.type)
    ]
    if (size := file.count_rows() * len(wanted) * 8) > MAX_BYTES:
        raise RecordingError(
            f"{path}: the file unpacks to {size} bytes; at most {MAX_BYTES} are allowed: split the file"
        )
    table = file.to_table(columns=wanted)
    names, columns = list[str](), list[NDArray[np.float64]]()
    for name, column in zip(table.column_names, table.columns, strict=True):
        if pa.types.is_timestamp(column.type):
            since = pc.subtract(
                column.cast(pa.timestamp("ns")).cast(pa.int64()),
                pc.min(column).cast(pa.timestamp("ns")).cast(pa.int64()),
            )
            names.append(f"{name} (ns)")
            columns.append(since.to_numpy().astype(np.float64))
        else:
            names.append(name)
            columns.append(column.to_numpy().astype(np.float64))
    if not columns:
        raise RecordingError(
            f"{path}: no columns of numbers: give one column per axis, with names such as gyro_x_rad_s"
        )
    return reader.read_columns(path, names, np.column_stack(columns), reading)


def write(file: IO[bytes], columns: Mapping[str, NDArray[np.generic]]) -> None:
    """Write columns (n,), by name, to a Parquet file; the names state the units."""
    pq.write_table(pa.table(dict(columns)), file)


def holds(path: Path, name: str) -> bool:
    """Return True if a file has a column of this name; False if the file is not Parquet."""
    try:
        return name in pq.read_schema(path).names
    except (OSError, pa.ArrowInvalid):
        return False
