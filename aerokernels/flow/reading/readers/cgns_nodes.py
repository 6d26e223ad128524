"""Nodes of a CGNS file in HDF5: their labels, names, data and children, read on demand."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import HDF5_MAGIC


class Node:
    """A node of a tree.

    Attributes:
        name: Its name.
        label: Its type, as in "Zone_t".
        data: Its data as an array or an HDF5 dataset; None for a node without data.
        type: The type of its data that the file states, as in "R8".
    """

    def __init__(
        self, name: str, label: str, data: Any = None, below: Callable[[], Iterable["Node"]] = tuple, type: str = ""
    ):
        """Create a node; `below` returns its children and is called when they are first needed."""
        self.name, self.label, self.data, self._below, self.type = name, label, data, below, type

    @cached_property
    def below(self) -> list["Node"]:
        """The children of the node."""
        return list(self._below())


@contextmanager
def opened(path: Path) -> Iterator[Node | None]:
    """Open a CGNS file in HDF5 as its root node; None for a file in ADF."""
    with path.open("rb") as stream:
        is_hdf5 = stream.read(len(HDF5_MAGIC)) == HDF5_MAGIC
    if not is_hdf5:
        yield None
        return
    import h5py

    with h5py.File(path, "r") as file:
        yield node_of(file)


def node_of(group: Any) -> Node:
    """Return an HDF5 group and all groups below it as a node."""
    import h5py

    data = group.get(" data")
    return Node(
        str(group.name.rsplit("/", 1)[-1]),
        decoded(group.attrs.get("label", b"")),
        data if isinstance(data, h5py.Dataset) else None,
        lambda: (node_of(own) for own in map(group.__getitem__, group) if isinstance(own, h5py.Group)),
        decoded(group.attrs.get("type", b"")),
    )


def children(node: Node, label: str) -> list[Node]:
    """Return the children of a node that have a given label."""
    return [own for own in node.below if own.label == label]


def child(node: Node, *names: str) -> Node | None:
    """Return the first child with data that has one of these names, or None."""
    return next((own for name in names for own in node.below if own.name == name and own.data is not None), None)


def array_paths(root: Node, *labels: str) -> Iterator[list[Node]]:
    """Yield the nodes above each array of the zones' parts of these labels, from the root to the array itself."""
    for base in children(root, "CGNSBase_t"):
        for zone in children(base, "Zone_t"):
            for part in (own for label in labels for own in children(zone, label)):
                for array in children(part, "DataArray_t"):
                    yield [root, base, zone, part, array]


def class_of(above: list[Node]) -> str:
    """Return the class of an array's data, as the last of its nodes that has one states it; empty if none does."""
    return next((text_of(own) for node in reversed(above) for own in reversed(children(node, "DataClass_t"))), "")


def data_of(node: Node) -> np.ndarray:
    """Return the data of a node, in HDF5's order of axes.

    Raises:
        ValueError: The node has no data.
    """
    if node.data is None:
        raise ValueError(f"node {node.name!r} has no data")
    return np.asarray(node.data[...])


def decoded(value: Any) -> str:
    """Return an HDF5 text attribute as a str."""
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)


def text_of(node: Node) -> str:
    """Return the data of a node as a text; empty for a node without data."""
    return "" if node.data is None else data_of(node).tobytes().decode("latin-1").strip(" \0")
