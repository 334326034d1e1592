"""The files of a data set, written so that no kill at any moment loses or doubles an episode.

========================  ==========================================================
``dataset.json``          what the data set is: options, scenario, prompts, versions
``frames/*.parquet``      a row a frame, one file for each group of prompts
``episodes/*.parquet``    a row an episode, of the same prompts under the same name
``parts/``                the same of single prompts, until their group is complete
``damaged/``              groups that were found damaged, and have been made anew
``timing.jsonl``          what each prompt took
========================  ==========================================================

A file appears under its name only when it is complete, the frames before the episodes:
prompts are done when their episodes are there. The episodes' file holds the SHA-256 of
the frames' file, and every page of both its own checksum. A group is merged from parts
before these go, so that parts which are left over from a kill are known by their prompts.
"""

from __future__ import annotations

import hashlib
import os
import uuid
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from robomirror_drake.exceptions import ResultError

DIGEST: Final = b"sha256 of the frames"
"""Key in the metadata of a file of episodes."""


class Shard(NamedTuple):
    """The two files of some prompts."""

    episodes: Path
    frames: Path


class Store:
    """The files of one data set."""

    def __init__(self, folder: Path) -> None:
        """A data set in a folder, which need not exist."""
        self.folder = folder

    def part(self, prompt: int) -> Shard:
        """Where the files of one prompt are."""
        return self._shard(self.folder / "parts", f"{prompt:06d}")

    def group(self, first: int, last: int) -> Shard:
        """Where the files of a group of prompts are, both ends included."""
        return self._shard(self.folder, f"{first:06d}-{last:06d}")

    def groups(self) -> list[Shard]:
        """All groups, in the order of their prompts; whole or not."""
        return self._shards(self.folder)

    def parts(self) -> list[Shard]:
        """The files of all single prompts; whole or not."""
        return self._shards(self.folder / "parts")

    def _shard(self, folder: Path, name: str) -> Shard:
        return Shard(*(folder / kind / f"{name}.parquet" for kind in ("episodes", "frames")))

    def _shards(self, folder: Path) -> list[Shard]:
        return [
            self._shard(folder, p.stem) for p in sorted((folder / "episodes").glob("*.parquet"))
        ]


def encode(episodes: pa.Table, frames: pa.Table) -> tuple[bytes, bytes]:
    """The two files of a shard as bytes: episodes, and frames with one row group."""
    sink = pa.BufferOutputStream()
    with _writer(sink, frames.schema) as writer:
        writer.write_table(frames, row_group_size=max(len(frames), 1))
    written = sink.getvalue().to_pybytes()
    return _encode_episodes(episodes, hashlib.sha256(written).hexdigest()), written


def write_shard(shard: Shard, episodes: bytes, frames: bytes) -> None:
    """Writes the two files, each whole or not at all.

    Raises:
        ResultError: They cannot be written.
    """
    write_whole(shard.frames, lambda path: path.write_bytes(frames))
    write_whole(shard.episodes, lambda path: path.write_bytes(episodes))


def merge(parts: Iterable[Shard], group: Shard) -> None:
    """Writes parts as one group, with a row group of frames for each, and removes them.

    Raises:
        ResultError: A part is damaged, or the group cannot be written.
    """
    parts = list(parts)
    tables = [read_episodes(part) for part in parts]

    def frames(path: Path) -> None:
        with _writer(path, pq.read_schema(parts[0].frames)) as writer:
            for part in parts:
                table = read_frames(part)
                writer.write_table(table, row_group_size=max(len(table), 1))

    digest = write_whole(group.frames, frames)
    together = _encode_episodes(pa.concat_tables(tables), digest)
    write_whole(group.episodes, lambda path: path.write_bytes(together))
    remove(parts)


def remove(shards: Iterable[Shard]) -> None:
    """Removes shards: the episodes first, for they say that the frames count."""
    for shard in shards:
        shard.episodes.unlink(missing_ok=True)
        shard.frames.unlink(missing_ok=True)


def check(shard: Shard) -> str | None:
    """What is wrong with a shard: the file and its fault; None where nothing is."""
    try:
        told = read_episodes(shard).schema.metadata[DIGEST].decode()
        if _digest(shard.frames) != told:
            return f"{shard.frames}: its checksum is not the one that {shard.episodes.name} tells"
    except (ResultError, KeyError) as error:
        return str(error)
    except OSError as error:
        return f"{shard.frames}: {error}"
    return None


def read_episodes(shard: Shard) -> pa.Table:
    """The episodes of a shard.

    Raises:
        ResultError: The file is missing or damaged.
    """
    return _read(shard.episodes)


def read_frames(shard: Shard, columns: list[str] | None = None) -> pa.Table:
    """The frames of a shard, with all columns or some of them.

    Raises:
        ResultError: The file is missing or damaged.
    """
    return _read(shard.frames, columns)


def read_shards(folder: Path, damaged: list[str] | None = None) -> Iterator[tuple[Shard, pa.Table]]:
    """All whole shards of a data set with their episodes, parts of a run that is not over too.

    Args:
        folder: Of the data set.
        damaged: Where to put what is wrong with shards that are skipped.
    """
    store, seen = Store(folder), set[int]()
    for shard in store.groups() + store.parts():
        fault = check(shard)
        if fault is not None:
            if damaged is not None:
                damaged.append(fault)
            continue
        episodes = read_episodes(shard)
        prompts = set(episodes["prompt_index"].to_pylist())
        if not prompts <= seen:
            yield shard, episodes
        seen |= prompts


def _writer(where: Path | pa.BufferOutputStream, schema: pa.Schema) -> pq.ParquetWriter:
    """A writer that splits floats by their bytes, which compresses motions by a third more."""
    real = {}
    for field in schema:
        listed = pa.types.is_fixed_size_list(field.type)
        if (field.type.value_type if listed else field.type) == pa.float32():
            real[f"{field.name}.list.element" if listed else field.name] = "BYTE_STREAM_SPLIT"
    return pq.ParquetWriter(
        where,
        schema,
        compression="zstd",
        use_dictionary=False,
        column_encoding=real,
        write_statistics=["episode", "frame"],
        write_page_checksum=True,
    )


def encode_table(table: pa.Table) -> bytes:
    """A table as a Parquet file, every page of it with its checksum."""
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd", write_page_checksum=True)
    return bytes(sink.getvalue().to_pybytes())


def _encode_episodes(episodes: pa.Table, digest: str) -> bytes:
    return encode_table(episodes.replace_schema_metadata({DIGEST: digest}))


def _read(path: Path, columns: list[str] | None = None) -> pa.Table:
    try:
        return pq.ParquetFile(path, page_checksum_verification=True).read(columns)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise ResultError(f"{path}: {error}") from error


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_whole(path: Path, write: Callable[[Path], object]) -> str:
    """Lets ``write`` fill a file beside, then gives it its name; returns its SHA-256."""
    work = path.with_name(f".{path.name}.{uuid.uuid4().hex}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(work)
        digest = _digest(work)
        with work.open("rb") as file:
            os.fsync(file.fileno())
        work.rename(path)
    except OSError as error:
        raise ResultError(f"cannot write {path}: {error}") from error
    return digest
