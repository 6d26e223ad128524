"""Check how the arrays of a Zarr store are encoded before Zarr opens it: a stranger's store must not run code.

Zarr decodes with whatever codecs a store names. One of them, "pickle", builds objects of Python from the store's bytes
and runs code in them. So only codecs of numbers and texts are allowed here, and objects only as texts.
"""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.process.foreign_files import FileFault, check_folder

MOST = 1 << 26  # [bytes] of a file of metadata
TEXTS = ("vlen-utf8", "vlen-bytes")
CODECS = (
    "adler32", "astype", "bitround", "blosc", "bytes", "bz2", "crc32", "crc32c", "delta", "endian", "fixedscaleoffset",
    "fletcher32", "gzip", "jenkins_lookup3", "lz4", "lzma", "packbits", "pcodec", "quantize", "sharding_indexed",
    "shuffle", "transpose", "zfpy", "zlib", "zstd", *TEXTS,
)  # fmt: skip


def check_codecs(store: Path) -> None:
    """Check the metadata of every array in a Zarr store, format 2 or 3, and that its links stay in it.

    Raises:
        ValueError: A codec or an object type that is not allowed, metadata that are no JSON, or a link that leaves the
            store.
    """
    check_folder(store)
    for folder, _, files in os.walk(store):
        for name in {".zarray", ".zmetadata", "zarr.json"}.intersection(files):
            path = Path(folder, name)
            try:
                for about in _arrays(_document(path), name):
                    _check(about)
            except (ValueError, RecursionError, AttributeError, TypeError, LookupError, OSError) as fault:
                reason = str(fault) or type(fault).__name__
                raise FileFault(f"{path}: {reason}: have the store written again with numbers and texts") from None


def _document(path: Path) -> Any:
    if not path.is_file() or path.stat().st_size > MOST:
        raise ValueError(f"no file of at most {MOST >> 20} MiB")
    return json.loads(path.read_bytes())


def _arrays(document: Any, name: str) -> Iterator[Any]:
    """Yield the metadata of the arrays that a file describes: its own, and those that it repeats of others."""
    if name == ".zmetadata":
        yield from (about for path, about in document["metadata"].items() if path.endswith(".zarray"))
        return
    yield document
    for inner in ((document.get("consolidated_metadata") or {}).get("metadata") or {}).values():
        yield from _arrays(inner, name)


def _check(array: dict) -> None:
    names = list(_codecs([array.get("compressor"), *(array.get("filters") or ()), *(array.get("codecs") or ())]))
    if found := [name for name in names if name not in CODECS]:
        raise ValueError(f"codec {found[0]!r} is not one of those for numbers and texts")
    if _has_objects(array.get("dtype")) and not set(names).intersection(TEXTS):
        raise ValueError("an array of Python objects, which are never read, because that could run code in them")


def _codecs(entries: list) -> Iterator[str]:
    """Yield the names of codecs, also of those within others; types of objects within them are refused."""
    for entry in filter(None, entries):
        about: dict[str, Any] = {"name": entry} if isinstance(entry, str) else entry
        yield str(about.get("id", about.get("name"))).removeprefix("numcodecs.")
        own = {**about, **(about.get("configuration") or {})}
        if any(_has_objects(own.get(key)) for key in ("dtype", "astype", "encode_dtype", "decode_dtype")):
            raise ValueError("a codec of Python objects, which are never read, because that could run code in them")
        yield from _codecs([*(own.get("codecs") or ()), *(own.get("index_codecs") or ())])


def _has_objects(kind: Any) -> bool:
    """Whether a type, as format 2 of Zarr writes it, is or contains Python's objects."""
    if isinstance(kind, list):
        return any(_has_objects(member[1]) for member in kind)
    try:
        return isinstance(kind, str) and np.dtype(kind).hasobject
    except TypeError:  # a type of format 3, which has no objects
        return False
