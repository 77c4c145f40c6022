"""Writer of sample columns to a file: .npz and .h5 hold arrays, .csv and .parquet one column per axis."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

AXES = "xyz"
ENDINGS = (".npz", ".csv", ".h5", ".parquet")
#: endings of the formats that hold arrays, and facts beside them
ARRAYS = (".npz", ".h5")
_ROWS = 10_000
Columns = dict[str, NDArray[Any]]
Tell = Callable[[int, int], None]


def write(
    file: BinaryIO, ending: str, columns: Columns, facts: Mapping[str, NDArray[np.generic]], tell: Tell | None = None
) -> None:
    """Write columns of samples to an open file, in the format that the file ending names.

    ending: one of ENDINGS, such as `.csv`. columns: arrays (n,), (n, 3) or (n, 4) by name; the name states the unit.
    facts: arrays of any shape about the whole recording, by name, such as `device`; only .npz and .h5 store them.
    tell(done, n): reports progress while a .csv is written: the number of rows written, and of all rows.
    """
    if ending == ".npz":
        np.savez(file, allow_pickle=False, **columns, **facts)
    elif ending == ".h5":
        from bridge.recording.formats import hdf5  # noqa: PLC0415 - an extra

        hdf5.write(file, {**columns, **facts})
    elif ending == ".parquet":
        from bridge.recording.formats import parquet  # noqa: PLC0415 - an extra

        parquet.write(file, flat(columns))
    else:
        single = flat(columns)
        n = len(next(iter(single.values())))
        file.write((",".join(single) + "\n").encode())
        for done, text in rows_of(list(single.values())):
            file.write(text.encode())
            if tell is not None:
                tell(done, n)


def flat(columns: Columns) -> Columns:
    """Split columns (n, 3) and (n, 4) into one column (n,) per axis, named as in a CSV, such as gyro_x_rad_s."""
    return {
        name: axis
        for column, values in columns.items()
        for name, axis in zip(_names(column, values), np.atleast_2d(values.T), strict=True)
    }


def _names(column: str, values: NDArray[np.generic]) -> list[str]:
    if values.ndim == 1:
        return [column]
    if column == "quat_wxyz":
        return [f"quat_{part}" for part in "wxyz"]
    name, unit = next((column[: -len(unit)], unit) for unit in ("_rad_s", "_m_s2") if column.endswith(unit))
    return [f"{name}_{axis}{unit}" for axis in AXES]


def rows_of(values: list[NDArray[np.generic]], separator: str = ",", missing: str = "nan") -> Iterator[tuple[int, str]]:
    """Format columns (n,) as rows of text; yields pairs: number of rows formatted so far, text of the latest rows.

    Each text has some thousands of rows, one a line. values: the columns. separator: text between cells.
    missing: text that replaces NaN.
    """
    forms = [{"f4": "%.9g", "f8": "%.9f"}.get(column.dtype.str[1:], "%s") for column in values]
    row_form, n = separator.join(forms) + "\n", len(values[0])
    for start in range(0, n, _ROWS):
        rows = zip(*(column[start : start + _ROWS].tolist() for column in values), strict=True)
        yield min(start + _ROWS, n), "".join(row_form % row for row in rows).replace("nan", missing)
