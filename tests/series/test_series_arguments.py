"""Arguments of `open_series`: those with a meaning for a source are taken, and no others are ignored."""

from pathlib import Path

import numpy as np
import pytest
import xarray

from aerokernels import Body, flow

TIME = [0.0, 1e-5, 2e-5]
PLACE = {"origin": [0.0, 0.0], "spacing": [1e-3] * 2, "geometry": "axisymmetric", "ambient_density": 0.5}
BALL = Body([[0.0, 0.0], [1e-3, 1e-3], [0.0, 2e-3]])
STREAM = flow.tunnel_conditions(2.0, 1e5, 300.0)


def arrays() -> list[np.ndarray]:
    return [np.full((5, 6), 0.5 + 0.1 * k) for k in range(3)]


def fields() -> list[flow.GridDensity]:
    return [flow.GridDensity(array, **PLACE) for array in arrays()]


def dataset(unit: float = 1.0) -> xarray.Dataset:
    places = {axis: unit * 1e-3 * np.arange(count) for axis, count in (("r", 5), ("z", 6))}
    return xarray.Dataset({"rho": (("time", "r", "z"), np.stack(arrays()))}, {"time": TIME, **places})


def source_of(kind: str, folder: Path) -> tuple[object, dict]:
    """A source of three snapshots, and the arguments that it needs beside a body, a free stream and a density."""
    if kind in ("files", "function"):
        for k, array in enumerate(arrays()):
            np.savez(folder / f"flow_{k}.npz", rho=array, x=-1e-3 * np.arange(6)[::-1], r=1e-3 * np.arange(5))
        own = {"read": lambda path, **options: fields()[int(path.stem[-1])]} if kind == "function" else {}
        return folder / "flow_*.npz", {"time": TIME, **own}
    if kind == "times":
        np.savez(folder / "a.npz", rho=arrays(), time=TIME, x=-1e-3 * np.arange(6)[::-1], r=1e-3 * np.arange(5))
        return folder / "a.npz", {}
    if kind == "NetCDF":
        dataset().to_netcdf(folder / "flow.nc", engine="h5netcdf")
        return folder / "flow.nc", {}
    return {
        "xarray": (dataset(), {}),
        "arrays": (arrays(), {"time": TIME, **PLACE}),
        "fields": (fields(), {"time": TIME}),
        "iterator": (iter(fields()), {"time": TIME}),
    }[kind]


@pytest.mark.parametrize("kind", ["files", "function", "times", "NetCDF", "xarray", "arrays", "fields", "iterator"])
def test_a_body_a_free_stream_an_ambient_density_and_a_count_go_with_any_source(tmp_path: Path, kind: str):
    """All three are attributes of any density field, but files and density fields refused some of them.

    Expected: the snapshots have them, and the series too; the densities remain. A function that reads has its own
    ambient density, unless it takes one.
    """
    source, needed = source_of(kind, tmp_path)
    more = {} if kind == "function" else {"ambient_density": 0.7}
    series = flow.open_series(source, **(needed | more | {"body": BALL, "conditions": STREAM, "count": 3}))
    assert series.body is BALL and series.conditions is STREAM
    for number in range(3):
        field = series[number]
        assert field.body is BALL and field.conditions is STREAM and series.lies_here(field)
        assert field.ambient_density == series.ambient_density == more.get("ambient_density", 0.5)
        assert np.array_equal(np.ravel(field.density), np.ravel(arrays()[number]))


@pytest.mark.parametrize("kind", ["arrays", "fields", "xarray"])
def test_an_option_of_a_reader_is_not_ignored_where_nothing_is_read_by_it(tmp_path: Path, kind: str):
    """A frame of these sources was dropped without a word, and so was a misspelt name."""
    source, needed = source_of(kind, tmp_path)
    with pytest.raises(TypeError, match=r"taken for .*, which take no frame, but time, time_step"):
        flow.open_series(source, frame="-x", **needed)
    with pytest.raises(TypeError, match="give wavelength to optical_series"):
        flow.open_series(source, wavelength=1e-6, **needed)


def test_the_unit_of_length_and_the_geometry_of_a_file_with_a_time_axis():
    """Expected: coordinates in millimetres that state no unit, and the geometry that their axes have."""
    series = flow.open_series(dataset(1e3), ambient_density=0.5, length_unit="mm", geometry="axisymmetric")
    assert np.allclose(series.mesh.spacing, 1e-3, rtol=1e-12) and series.mesh.geometry == "axisymmetric"
    with pytest.raises(ValueError, match="'5 kg'"):
        flow.open_series(dataset(), ambient_density=0.5, length_unit="5 kg")


def test_restarts_of_su2_have_a_mesh_elsewhere(tmp_path: Path):
    """`mesh`, the path that `flow.read` takes, was refused: it is the mesh of arrays as well."""
    (tmp_path / "meshes").mkdir()
    y, x = (each.ravel() for each in np.meshgrid([0.0, 1.0], [0.0, 1.0, 2.0], indexing="ij"))
    points = [f"{a} {b} {k}" for k, (a, b) in enumerate(zip(x, y, strict=True))]
    cells = ["9 0 1 4 3 0", "9 1 2 5 4 1"]
    text = ["NDIME= 2", "NELEM= 2", *cells, "NPOIN= 6", *points, "NMARK= 0"]
    (tmp_path / "meshes" / "a.su2").write_text("\n".join(text) + "\n")
    for number in range(2):
        rows = [f"{k}, {a}, {b}, {1.0 + number}" for k, (a, b) in enumerate(zip(x, y, strict=True))]
        (tmp_path / f"flow_{number}.csv").write_text("\n".join(['"PointID", "x", "y", "Density"', *rows]) + "\n")
    mesh = str(tmp_path / "meshes" / "a.su2")
    series = flow.open_series(tmp_path / "flow_*.csv", time_step=1.0, mesh=mesh, ambient_density=1.0)
    assert [float(field.density.mean()) for field in series] == [1.0, 2.0]
