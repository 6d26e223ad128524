"""CGNS files in HDF5, node by node as its file mapping describes them."""

from pathlib import Path

import numpy as np

TYPES = {"int32": "I4", "float32": "R4", "float64": "R8"}


def node(parent, name: str, label: str, data=None):
    """A node under another: its label and its data, a text or an array in the order of HDF5."""
    own = parent.create_group(name, track_order=True)
    kind = "MT"
    if isinstance(data, str):
        own[" data"], kind = np.frombuffer(data.encode(), np.int8), "C1"
    elif data is not None:
        array = np.asarray(data)
        array = array if array.dtype.kind == "f" else array.astype(np.int32)
        own[" data"], kind = array, TYPES[array.dtype.name]
    for key, value, size in (("name", name, 33), ("label", label, 33), ("type", kind, 3)):
        own.attrs.create(key, np.bytes_(value), dtype=f"S{size}")
    own.attrs["flags"] = np.array([1], np.int32)
    return own


def cgns(path: Path, axes, density, conditions, *, elements=None, families=(), more=()) -> Path:
    """One zone with values at its vertices.

    Args:
        path: Where to.
        axes: Coordinates of the vertices, arrays in order [k, j, i], or flat for elements.
        density: Likewise.
        conditions: (name, type, [(node's name, label, data), ...]) of each BC_t.
        elements: (CGNS' type, corners from 0 on) of each section; None for a structured zone.
        families: (name, type) of each.
        more: (name, label, data) of nodes of the base.
    """
    import h5py

    with h5py.File(path, "w", track_order=True) as file:
        for key, value, size in (
            ("name", "HDF5 MotherNode", 33),
            ("label", "Root Node of HDF5 File", 33),
            ("type", "MT", 3),
        ):
            file.attrs.create(key, np.bytes_(value), dtype=f"S{size}")
        file[" format"] = np.frombuffer(b"IEEE_LITTLE_32\0", np.int8)
        file[" hdf5version"] = np.frombuffer(b"HDF5 Version 1.10.0".ljust(33, b"\0"), np.int8)
        node(file, "CGNSLibraryVersion", "CGNSLibraryVersion_t", np.array([3.4], np.float32))
        base = node(file, "Base", "CGNSBase_t", [len(axes), len(axes)])
        for part in more:
            node(base, *part)
        for name, kind in families:
            node(node(base, name, "Family_t"), "FamilyBC", "FamilyBC_t", kind)
        counts = np.array(axes[0].shape[::-1])
        if elements is not None:
            counts = np.array([axes[0].size])
            size = [counts, [len(elements[0][1])], [0]]
        else:
            size = [counts, counts - 1, 0 * counts]
        zone = node(base, "Zone", "Zone_t", size)
        node(zone, "ZoneType", "ZoneType_t", "Structured" if elements is None else "Unstructured")
        grid = node(zone, "GridCoordinates", "GridCoordinates_t")
        for letter, own in zip("XYZ", axes, strict=False):
            node(grid, f"Coordinate{letter}", "DataArray_t", own)
        node(node(zone, "Flow", "FlowSolution_t"), "Density", "DataArray_t", density)
        first = 1
        for kind, corners in elements or ():
            section = node(zone, f"Elements {first}", "Elements_t", [kind, 0])
            node(section, "ElementRange", "IndexRange_t", [first, first + len(corners) - 1])
            node(section, "ElementConnectivity", "DataArray_t", corners.ravel() + 1)
            first += len(corners)
        where = node(zone, "ZoneBC", "ZoneBC_t")
        for name, kind, parts in conditions:
            condition = node(where, name, "BC_t", kind)
            for part in parts:
                node(condition, *part)
    return path
