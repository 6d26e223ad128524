"""Damage the contents of HDF5 files: the file stays valid as a container, but its contents are wrong.

A changed byte of such a file mostly spoils the container. Errors of other programs are deeper: a node that is missing
or duplicated, arrays of another shape or type, counts that do not agree, another label, circular links.
"""

import io
from contextlib import suppress

import numpy as np
from numpy.random import Generator

MAGIC = b"\x89HDF\r\n\x1a\n"
WILD = (np.nan, np.inf, -np.inf, -1.0, 0.0, 1e300, -1e300, 1e-300)
WILD_WHOLE = (-1, 0, 1, 2, 3, 2**31 - 1, -(2**31), 65536)


def has_structure(data: bytes) -> bool:
    """Whether data is an HDF5 file."""
    return data.startswith(MAGIC)


def damage_structure(data: bytes, random: Generator) -> bytes:
    """Spoil the contents of a valid HDF5 file in one to three ways."""
    import h5py

    stream = io.BytesIO(data)
    with h5py.File(stream, "r+") as file:
        for _ in range(int(random.integers(1, 4))):
            names: list[str] = []
            file.visit(names.append)
            if not names:
                break
            with suppress(OSError, ValueError, KeyError, RuntimeError, TypeError):  # changes that HDF5 does not allow
                _spoil(file, names[int(random.integers(len(names)))], random)
    return stream.getvalue()


def _spoil(file, name: str, random: Generator) -> None:
    import h5py

    item, parent = file[name], file[name].parent
    own = name.rsplit("/", 1)[-1]
    way = int(random.integers(12))
    if way == 0:
        del parent[own]
    elif way == 1:
        parent.move(own, own + "2")
    elif way == 2:
        file.copy(item, parent, name=own + " copy")
    elif way == 3:
        del parent[own]
        parent[own] = h5py.SoftLink(parent.name)
    elif way == 4:
        del parent[own]
        parent.create_group(own)
    elif way == 5 and len(item.attrs):
        key = list(item.attrs)[int(random.integers(len(item.attrs)))]
        _spoil_attribute(item, key, random)
    elif isinstance(item, h5py.Dataset) and item.size and item.dtype.kind in "iuf":
        _replace(parent, own, _spoiled(item[...], way, random))


def _spoil_attribute(item, key: str, random: Generator) -> None:
    value = item.attrs[key]
    way = int(random.integers(4))
    if way == 0:
        del item.attrs[key]
    elif way == 1:
        item.attrs[key] = 3.5
    elif way == 2:
        item.attrs[key] = np.array([7, -1], np.int32)
    elif isinstance(value, (bytes, np.bytes_)):
        swapped = bytearray(value.ljust(2))
        swapped[int(random.integers(len(swapped)))] = int(random.integers(32, 127))
        item.attrs.create(key, np.bytes_(bytes(swapped)), dtype=f"S{max(len(value), 1)}")
    else:
        item.attrs[key] = np.bytes_(b"text")


def _replace(parent, own: str, values: np.ndarray) -> None:
    attributes = dict(parent[own].attrs)
    del parent[own]
    made = parent.create_dataset(own, data=values)
    for key, value in attributes.items():
        made.attrs[key] = value


def _spoiled(values: np.ndarray, way: int, random: Generator) -> np.ndarray:
    """An array with an error in its values, shape or type."""
    flat = values.ravel()
    if way == 6:  # impossible values
        wild = random.choice(np.array(WILD if values.dtype.kind == "f" else WILD_WHOLE))
        flat = flat.copy()
        with np.errstate(over="ignore", invalid="ignore"):
            flat[random.integers(0, flat.size, int(random.integers(1, 4)))] = np.array([wild]).astype(values.dtype)
        return flat.reshape(values.shape)
    if way == 7:  # too few of them, or too many
        count = int(random.integers(0, 2 * flat.size + 1))
        return np.resize(flat, count)
    if way == 8:  # another shape
        return flat[None] if random.random() < 0.5 else values.T.copy()
    if way == 9:  # another type
        kind = random.choice(np.array(["i1", "i4", "i8", ">f8", "f4", "f8", "u8"]))
        with np.errstate(over="ignore", invalid="ignore"):
            return values.astype(str(kind))
    if way == 10:
        return values[tuple(slice(None, None, -1) for _ in values.shape)].copy()
    return np.zeros_like(values)
