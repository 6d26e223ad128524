"""Damaging files on purpose: what a broken disk, a broken transfer or another program leaves of them."""

from collections import Counter
from pathlib import Path

import cgns_writer
import numpy as np
import vtk_writers
import writers

from tests.draws.damaged_files import DamagedCopies


def plain(folder: Path, kind: str) -> Path:
    """A sound file or case of a kind in a folder: what is to be read."""
    x, y = writers.grid(9, 7)
    density = writers.rho(x, y)
    writers.NI, writers.NJ = 9, 7
    try:
        if kind == "foam-volume":
            return _volume(folder / "case")
        if kind.startswith("foam"):
            return writers.foam_wedge(folder / "case", binary="binary" in kind, wedge="plane" not in kind)
        if kind.startswith("plot3d"):
            return writers.plot3d(folder / "a", records="records" in kind, text="text" in kind)
        if kind.startswith("tecplot-text"):
            return writers.tecplot_text(folder / "a.dat", in_cells="cells" in kind, elements="elements" in kind)
        if kind.startswith("tecplot-binary"):
            return writers.tecplot_binary(folder / "a.plt", in_cells="cells" in kind, elements="elements" in kind)
        if kind.startswith("su2"):
            return writers.su2(folder, binary="binary" in kind)
        if kind == "npz":
            np.savez(folder / "a.npz", x=x, y=y, rho=density)
            return folder / "a.npz"
        if kind == "csv":
            table = np.stack([x.ravel(), y.ravel(), density.ravel()], axis=1)
            np.savetxt(folder / "a.csv", table, delimiter=",", header="x,y,rho", comments="")
            return folder / "a.csv"
        if kind.startswith("cgns"):
            return _cgns(folder / "a.cgns", kind, x, y, density)
        if kind in ("hdf5", "netcdf", "netcdf-classic"):
            return _labelled(folder, kind, x, y, density)
        return vtk_writers.vtk_file(folder / f"a.{kind.split('-')[0]}", kind)
    finally:
        writers.NI, writers.NJ = 31, 21


def _volume(case: Path) -> Path:
    """A square rod as the body of a volume of hexahedra."""
    from test_volumes import cube, foam_case

    points, corners = cube(6)
    middle = points[corners].mean(axis=1)

    def rod(p):
        return (np.abs(p[:, 1:] - 0.5) < 0.17).all(axis=1) & (p[:, 0] > 0.49)

    return foam_case(case, points, corners[~rod(middle)], lambda p: rod(p) & (p[:, 0] < 0.999))


def _cgns(path: Path, kind: str, x, y, density) -> Path:
    """A zone with a wall: of a plane, structured or of elements, or a structured volume."""
    if kind == "cgns-elements":
        wall = [("PointList", "IndexArray_t", [[1, 2, 3, 4]])]
        cells = [(7, writers.quads(9, 7))]
        return cgns_writer.cgns(
            path, (x.ravel(), y.ravel()), density.ravel(), [("low", "BCWall", wall)], elements=cells
        )
    if kind == "cgns-volume":
        third = np.broadcast_to(0.01 * np.arange(4.0)[:, None, None], (4, *x.shape)).copy()
        axes = np.stack([x] * 4), np.stack([y] * 4), third
        wall = [("PointRange", "IndexRange_t", [[1, 1, 1], [9, 1, 4]])]
        return cgns_writer.cgns(path, axes, np.stack([density] * 4), [("low", "BCWallInviscid", wall)])
    wall = [("PointRange", "IndexRange_t", [[1, 1], [9, 1]])]
    return cgns_writer.cgns(path, (x, y), density, [("low", "BCWall", wall)])


def _labelled(folder: Path, kind: str, x, y, density) -> Path:
    if kind == "hdf5":
        import h5py

        with h5py.File(folder / "a.h5", "w") as file:
            file["x"], file["y"], file["rho"] = x, y, density
        return folder / "a.h5"
    import xarray

    data = xarray.Dataset({"rho": (("j", "i"), density), "x": (("j", "i"), x), "y": (("j", "i"), y)})
    data.to_netcdf(folder / "a.nc", engine="scipy" if "classic" in kind else "h5netcdf")
    return folder / "a.nc"


def fuzz(folder: Path, kind: str, seeds) -> Counter[str]:
    """How many damaged copies of a sound file were refused, and how many read: by chance the damage may not matter."""
    sound = folder / "sound"
    sound.mkdir()
    copies = DamagedCopies(plain(sound, kind), sound, folder / "copy")
    return Counter(map(copies.outcome, seeds))


KINDS = (
    "foam-ascii", "foam-binary", "foam-plane-binary", "foam-volume",
    "plot3d-records", "plot3d-plain", "plot3d-text", "tecplot-text",
    "tecplot-text-cells", "tecplot-text-elements", "tecplot-binary", "tecplot-binary-cells", "tecplot-binary-elements",
    "su2-binary", "su2-text", "npz", "csv",
)  # fmt: skip
CHILD_KINDS = (
    "hdf5", "netcdf", "netcdf-classic", "cgns", "cgns-elements", "cgns-volume",
    "vtu", "vtu-ascii", "vts", "vtr", "vti", "vtk", "vtk-ascii",
)  # fmt: skip
