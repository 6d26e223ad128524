"""Nodes of a CGNS file in HDF5: their labels, names and data."""

from collections.abc import Iterator

import numpy as np

HDF5 = b"\x89HDF\r\n\x1a\n"


def children(node, label: str) -> Iterator:
    """Nodes of a label below a node."""
    for name in node:
        own = node[name]
        if decoded(own.attrs.get("label", b"")) == label:
            yield own


def child(node, *names: str):
    """The first node with data below a node that has one of these names, or None."""
    return next((node[name] for name in names if name in node and " data" in node[name]), None)


def data_of(node) -> np.ndarray:
    """The data of a node, in the order of HDF5."""
    return np.asarray(node[" data"][...])


def decoded(value) -> str:
    """A text from what HDF5 has of it."""
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)


def text_of(node) -> str:
    """The data of a node as a text; empty for a node without."""
    return data_of(node).tobytes().decode("latin-1").strip(" \0") if " data" in node else ""


def name_of(node) -> str:
    """The name of a node."""
    return str(node.name.rsplit("/", 1)[-1])
