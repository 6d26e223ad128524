"""Damaging files on purpose: what a broken disk, a broken transfer or another program leaves of them."""

import shutil
from pathlib import Path

import numpy as np
import vtk_writers
import writers
from numpy.random import Generator

from aerokernels.flow import DensityField, read


def plain(folder: Path, kind: str) -> Path:
    """A sound file or case of a kind in a folder: what is to be read."""
    x, y = writers.grid(9, 7)
    density = writers.rho(x, y)
    writers.NI, writers.NJ = 9, 7
    try:
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
        if kind in ("hdf5", "netcdf", "netcdf-classic"):
            return _labelled(folder, kind, x, y, density)
        return vtk_writers.vtk_file(folder / f"a.{kind.split('-')[0]}", kind)
    finally:
        writers.NI, writers.NJ = 31, 21


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


def damage(data: bytes, random: Generator) -> bytes:
    """One of many ways to spoil a file."""
    way = int(random.integers(10))
    size = len(data)
    at, length = int(random.integers(size)), int(random.integers(1, max(2, size // 4)))
    if way == 0:
        return data[:at]
    if way == 1:
        return data[:at] + data[at + length :]
    if way == 2:
        return data[:at] + data[at : at + length] + data[at:]
    if way == 3:  # a text where numbers were, or the reverse
        return data[:at] + b"not a number " * 3 + data[at + 39 :]
    if way == 4:
        return data[:at] + bytes(random.integers(0, 256, 8, dtype=np.uint8)) + data[at + 8 :]
    if way == 5:  # the byte order of a part
        part = data[at // 8 * 8 : at // 8 * 8 + length // 8 * 8 + 8]
        part = part[: len(part) // 8 * 8]
        swapped = np.frombuffer(part, "<u8").byteswap().tobytes()
        return data[: at // 8 * 8] + swapped + data[at // 8 * 8 + len(part) :]
    if way == 6:
        wild = random.choice(np.array([np.nan, np.inf, -1.0, 1e300, 0.0]))
        return data[: at // 8 * 8] + np.float64(wild).tobytes() + data[at // 8 * 8 + 8 :]
    if way == 7:  # a digit of a count or of a number
        digits = [k for k, byte in enumerate(data) if 48 <= byte <= 57]
        if not digits:
            return data[:at]
        place = digits[int(random.integers(len(digits)))]
        return data[:place] + random.choice(np.array([b"9", b"-", b"0", b"999999999", b"e"])) + data[place + 1 :]
    if way == 8:
        return data + data[at : at + length]
    wild = int(random.choice(np.array([-1, 0, 2**31 - 1, -(2**31), 65536])))
    return data[: at // 4 * 4] + np.int32(wild).tobytes() + data[at // 4 * 4 + 4 :]


def outcome(path: Path) -> str:
    """Whether it was "read" or "refused"; whatever else happens, happens to the caller."""
    try:
        flow = read(path)
    except ValueError as fault:
        assert str(fault) and "\n" not in str(fault), repr(fault)
        return "refused"
    assert isinstance(flow, DensityField)
    assert np.isfinite(flow.density).all() and (flow.density > 0.0).all()
    return "read"


def fuzz(folder: Path, kind: str, seeds) -> dict[str, int]:
    """How many damaged copies of a sound file were refused, and how many read: by chance the damage may not matter."""
    sound = folder / "sound"
    sound.mkdir()
    path = plain(sound, kind)
    assert outcome(path) == "read", kind
    files = sorted(file for file in sound.rglob("*") if file.is_file())
    contents = {file: file.read_bytes() for file in files}
    counts = {"read": 0, "refused": 0}
    copy = folder / "copy"
    for seed in seeds:
        random = np.random.default_rng(seed)
        chosen = files[int(random.integers(len(files)))]
        if not copy.exists():
            shutil.copytree(sound, copy)
        spoilt = copy / chosen.relative_to(sound)
        spoilt.write_bytes(damage(contents[chosen], random))
        try:
            counts[outcome(copy / path.relative_to(sound))] += 1
        except BaseException:
            print(f"{kind}, seed {seed}, {chosen.name}")
            raise
        spoilt.write_bytes(contents[chosen])
    return counts


KINDS = (
    "foam-ascii", "foam-binary", "foam-plane-binary", "plot3d-records", "plot3d-plain", "plot3d-text", "tecplot-text",
    "tecplot-text-cells", "tecplot-text-elements", "tecplot-binary", "tecplot-binary-cells", "tecplot-binary-elements",
    "su2-binary", "su2-text", "npz", "csv",
)  # fmt: skip
CHILD_KINDS = ("hdf5", "netcdf", "netcdf-classic", "vtu", "vtu-ascii", "vts", "vtr", "vti", "vtk", "vtk-ascii")
