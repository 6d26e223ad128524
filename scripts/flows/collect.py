"""Read an OpenFOAM case's mesh and dumps (ASCII) and order them: nodes (i, j), and cell averages over the dumps."""

import re
from pathlib import Path

import model
import numpy as np


def read_nodes(folder: Path, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Node coordinates x and r [m], shape (ni + 1, nj + 1): first index along the body, second outward.

    blockMesh numbers the cells block by block, along the body first; the points it merges in no simple order. So a node
    is found as the one point that the cells around it share, and that the cells further off do not have.
    """
    mesh = folder / "constant" / "polyMesh"
    points = np.array([row.split() for row in re.findall(r"^\(([^()]*)\)$", _body(mesh / "points"), re.M)], float)
    faces = [[int(k) for k in row.split()] for row in re.findall(r"^\d+\(([\d ]*)\)$", _body(mesh / "faces"), re.M)]
    owner = [int(row) for row in re.findall(r"^\d+$", _body(mesh / "owner"), re.M)][1:]
    boundary = (mesh / "boundary").read_text()
    front = re.search(r"front\s*\{.*?nFaces\s+(\d+);\s*startFace\s+(\d+);", boundary, re.S)
    count, start = int(front[1]), int(front[2])
    order = grid_order(scale)
    holds = np.empty(order.shape, dtype=object)
    holds.ravel()[np.argsort(order.ravel())[owner[start : start + count]]] = [
        set(f) for f in faces[start : start + count]
    ]
    ni, nj = order.shape
    label = np.empty((ni + 1, nj + 1), dtype=int)
    for i in range(ni + 1):
        for j in range(nj + 1):
            window = {(a, b) for a in range(i - 2, i + 2) for b in range(j - 2, j + 2) if 0 <= a < ni and 0 <= b < nj}
            around = {(a, b) for a, b in window if a in (i - 1, i) and b in (j - 1, j)}
            common = set.intersection(*(holds[cell] for cell in around))
            (label[i, j],) = common.difference(*(holds[cell] for cell in window - around))
    x, y, z = points[label].transpose(2, 0, 1)
    return x, np.hypot(y, z)


def grid_order(scale: float) -> np.ndarray:
    """OpenFOAM's cell number at each place of the grid, shape (ni, nj)."""
    along, across = model.cell_counts(scale)
    starts = np.cumsum([0, *along[:-1]]) * across
    blocks = [
        start + np.arange(count * across).reshape(across, count).T for start, count in zip(starts, along, strict=True)
    ]
    return np.concatenate(blocks)


def read_averages(folder: Path, dumps: list[int], scale: float) -> dict[str, np.ndarray]:
    """Cell averages over the dumps, each of shape (ni, nj).

    rho [kg/m3] and its spread over the dumps rho_std, p [Pa], and the velocity along x and r, u and v [m/s].
    """
    order = grid_order(scale)
    rho = np.stack([_read_field(folder / str(dump) / "rho") for dump in dumps])
    p = np.mean([_read_field(folder / str(dump) / "p") for dump in dumps], axis=0)
    velocity = np.mean([_read_field(folder / str(dump) / "U") for dump in dumps], axis=0)
    cells = {"rho": rho.mean(axis=0), "rho_std": rho.std(axis=0), "p": p, "u": velocity[:, 0], "v": velocity[:, 1]}
    return {name: values[order].astype(np.float32) for name, values in cells.items()}


def _read_field(path: Path) -> np.ndarray:
    """The internal field of an ASCII volume field, shape (cell_count,) or (cell_count, 3)."""
    match = re.search(r"internalField\s+nonuniform\s+List<(\w+)>\s+(\d+)\s*\((.*?)^\)", path.read_text(), re.S | re.M)
    if match is None:
        raise ValueError(f"{path} has no nonuniform internal field in ASCII")
    values = np.array(match[3].replace("(", " ").replace(")", " ").split(), float)
    return values.reshape(int(match[2]), -1).squeeze(axis=1) if match[1] == "scalar" else values.reshape(-1, 3)


def _body(path: Path) -> str:
    """A mesh file's text after its header."""
    return path.read_text().split("// * *", 1)[1]
