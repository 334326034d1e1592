"""The files of a study, written so that no kill at any moment loses or doubles a command.

====================== ===================================================================
``study.json``         what the study is: options, scenario, commands, weights, versions
``screened/``          how the own motion of each command ends, a file a command
``results/``           what the variants make of each command, a file a command
``screened.parquet``   all of the first, once the study is over
``results.parquet``    all of the second; a row a command and variant
``commands.csv``       the commands that were compared on, as ``prompts`` of another study
====================== ===================================================================
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from robomirror_drake.dataset.columns import Column, rows_table
from robomirror_drake.dataset.shards import encode_table, write_whole
from robomirror_drake.study.records import Row


class Part:
    """A folder with a file for each command."""

    def __init__(self, folder: Path, columns: Sequence[Column]) -> None:
        """Rows of these columns; the folder need not exist."""
        self.folder = folder
        self._columns = columns

    def write(self, command: int, rows: Sequence[Row]) -> list[Row]:
        """Writes the rows of a command, all or none, and returns them with all columns.

        Raises:
            ResultError: They cannot be written.
        """
        write_file(self.folder / f"{command:06d}.parquet", rows, self._columns)
        return [{column.name: row.get(column.name) for column in self._columns} for row in rows]

    def read(self, damaged: list[str], mend: bool = True) -> dict[int, list[Row]]:
        """The rows of each command.

        Args:
            damaged: Where to put what was wrong.
            mend: Whether to remove what is damaged or left of a kill; not in the folder of a
                study that may be running.
        """
        for partial in self.folder.glob(".*.partial") if mend else ():
            partial.unlink()
        found: dict[int, list[Row]] = {}
        for path in sorted(self.folder.glob("*.parquet")):
            try:
                table = pq.ParquetFile(path, page_checksum_verification=True).read()
                found[int(path.stem)] = table.to_pylist()
            except (pa.ArrowException, OSError, ValueError) as error:
                damaged.append(f"{path}: {error}")
                if mend:
                    path.unlink()
        return found


def write_file(path: Path, rows: Sequence[Row], columns: Sequence[Column]) -> None:
    """Writes rows as one Parquet file, whole or not at all.

    Raises:
        ResultError: It cannot be written.
    """
    file = encode_table(rows_table(rows, columns))
    write_whole(path, lambda work: work.write_bytes(file))
