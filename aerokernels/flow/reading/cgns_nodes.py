"""Nodes of a CGNS file in HDF5: their labels, names, data, and the nodes below them, read when they are asked for."""

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any

import numpy as np

HDF5 = b"\x89HDF\r\n\x1a\n"


class Node:
    """A node of a tree.

    Attributes:
        name: Its name.
        label: What it is, as in "Zone_t".
        data: Its data as an array, or what HDF5 gives in place of one; None for a node without.
    """

    def __init__(self, name: str, label: str, data: Any = None, below: Callable[[], Iterable["Node"]] = tuple):
        """A node, and what gives the nodes below it when they are first asked for."""
        self.name, self.label, self.data, self._below = name, label, data, below

    @cached_property
    def below(self) -> list["Node"]:
        """The nodes below it."""
        return list(self._below())


def node_of(group: Any) -> Node:
    """A group of HDF5, with what is below it, as a node."""
    import h5py

    data = group.get(" data")
    return Node(
        str(group.name.rsplit("/", 1)[-1]),
        decoded(group.attrs.get("label", b"")),
        data if isinstance(data, h5py.Dataset) else None,
        lambda: (node_of(own) for own in map(group.__getitem__, group) if isinstance(own, h5py.Group)),
    )


def children(node: Node, label: str) -> list[Node]:
    """Nodes of a label below a node."""
    return [own for own in node.below if own.label == label]


def child(node: Node, *names: str) -> Node | None:
    """The first node with data below a node that has one of these names, or None."""
    return next((own for name in names for own in node.below if own.name == name and own.data is not None), None)


def data_of(node: Node) -> np.ndarray:
    """The data of a node, in the order of HDF5.

    Raises:
        ValueError: It has none.
    """
    if node.data is None:
        raise ValueError(f"node {node.name!r} has no data")
    return np.asarray(node.data[...])


def decoded(value: Any) -> str:
    """A text from what HDF5 has of it."""
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)


def text_of(node: Node) -> str:
    """The data of a node as a text; empty for a node without."""
    return "" if node.data is None else data_of(node).tobytes().decode("latin-1").strip(" \0")
