"""Opening series: files with a time axis, numbered files, arrays and iterators; and what is refused."""

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray

from aerokernels import DensityField, QuadMesh, flow
from aerokernels.files import netcdf_reading
from aerokernels.flow.series_sources import in_order

TIME = [0.0, 1e-5, 2e-5]
GRID = {"geometry": "volume", "origin": [0.0, 0.0, 0.0], "spacing": [1e-3] * 3, "ambient_density": 0.5}


def arrays(count: int = 3) -> list[np.ndarray]:
    return [np.full((4, 5, 6), 0.5 + 0.1 * k, dtype=np.float32) for k in range(count)]


def dataset(units: str = "m", axes=("x", "y", "z"), scale: float = 1.0) -> xarray.Dataset:
    shape = dict(zip(("x", "y", "z", "r"), (4, 5, 6, 4), strict=True))
    places = {axis: (axis, scale * 1e-3 * np.arange(shape[axis]), {"units": units}) for axis in axes}
    values = np.stack([np.full([shape[axis] for axis in axes], 0.5 + 0.1 * k) for k in range(3)])
    return xarray.Dataset({"rho": (("time", *axes), values)}, {"time": TIME, **places}, {"ambient_density": 0.5})


def square_mesh() -> QuadMesh:
    y, z = np.meshgrid(np.linspace(0, 1e-2, 5), np.linspace(0, 2e-2, 6), indexing="ij")
    return QuadMesh.structured(y, z, "planar")


def test_an_iterator_is_read_once_and_in_order():
    read = []

    def items():
        for k, array in enumerate(arrays()):
            read.append(k)
            yield array

    series = flow.open_series(items(), time_step=1e-5, count=3, **GRID)
    assert read == [0]  # its shape
    series.density(0), series.density(2)
    assert read == [0, 1, 2]
    with pytest.raises(ValueError, match="was read before"):
        series.density(1)
    short = flow.open_series(iter(arrays(1)), time=TIME, **GRID)
    short.density(0)
    with pytest.raises(ValueError, match="fewer snapshots than times"):
        short.density(1)


def test_a_solver_may_reuse_its_array():
    """It computes the next snapshot, in place, while this one is processed: what was read does not change."""

    def steps():
        density = np.empty((4, 5, 6))
        for k in range(3):
            density[...] = 1.0 + 0.1 * k
            yield density

    series = flow.open_series(steps(), time=TIME, **GRID)
    found = [series.density(k) for k in range(3)]
    assert [float(one.min()) for one in found] == [float(one.max()) for one in found] == [1.0, 1.1, 1.2]


def test_an_array_of_another_library_comes_by_dlpack():
    class Foreign:
        def __init__(self, array):
            self.array = array

        def __dlpack__(self, **options):
            return self.array.__dlpack__(**options)

        def __dlpack_device__(self):
            return self.array.__dlpack_device__()

    series = flow.open_series([Foreign(array) for array in arrays()], time=TIME, **GRID)
    assert np.array_equal(series.density(1), arrays()[1])


@pytest.mark.parametrize(("kind", "axes"), [("nc", ("x", "y", "z")), ("zarr", ("y", "z")), ("nc", ("r", "z"))])
def test_files_with_a_time_axis(kind: str, axes, tmp_path: Path):
    path = tmp_path / f"flow.{kind}"
    data = dataset("mm", axes, 1e3)
    if kind == "nc":
        data.to_netcdf(path, engine="h5netcdf")
    else:
        pytest.importorskip("zarr")
        data.to_zarr(path, consolidated=False)
    series = flow.open_series(path)
    assert list(series.time) == TIME and series.ambient_density == 0.5
    assert series.mesh.geometry == {3: "volume", 2: "planar" if axes[0] == "y" else "axisymmetric"}[len(axes)]
    np.testing.assert_allclose(series.mesh.spacing, 1e-3, rtol=1e-12)
    assert series[2].density_at([[0.0, 1e-3, 1e-3]]) == pytest.approx(0.7)


def test_numbered_files_are_sorted_by_number_and_read_by_a_function(tmp_path: Path):
    for k in (10, 2, 1):
        np.save(tmp_path / f"flow_{k}.npy", np.full((4, 5, 6), 0.1 * k))

    def read(path: Path) -> DensityField:
        return flow.GridDensity(np.load(path), [0, 0, 0], [1e-3] * 3, "volume", 0.5)

    series = flow.open_series(str(tmp_path / "flow_*.npy"), time=TIME, read=read)
    assert [round(float(field.density.mean()), 9) for field in series] == [0.1, 0.2, 1.0]
    again = flow.open_series([tmp_path / "flow_2.npy"], time=[0.0], read=read)
    assert again.density(0).shape == (4, 5, 6)


@pytest.mark.parametrize(
    "names",
    [
        ["u_0.05", "u_0.1", "u_0.15", "u_0.2", "u_0.25"],
        ["run1.8", "run1.9", "run1.10", "run1.11"],
        ["t3_9", "t3_10", "t3_11"],
        ["0.33s", "0.67s", "1s", "1.33s"],
        ["b_3", "b_12", "b_100"],
    ],
)
def test_numbers_in_names_are_times_or_counters(names: list[str]):
    """Whichever grows evenly; 0.15 came after 0.2."""
    paths = [Path(f"{name}.vtu") for name in names]
    assert in_order(paths[::-1]) == paths


def test_a_missing_file_is_told_where_all_get_even_times(tmp_path: Path):
    """With one time for each there is nothing to tell, nor with names that have no numbers in common."""

    def opened(*names: object, **times) -> flow.Series:
        for name in names:
            (tmp_path / f"f_{name}.npy").touch()
        return flow.open_series([tmp_path / f"f_{name}.npy" for name in names], read=lambda path: still, **times)

    still = flow.GridDensity(np.full((3, 3), 1.0), [0, 0], [1e-3] * 2, "planar", 1.0)
    with pytest.warns(UserWarning, match=r"f_40\.npy comes after f_20\.npy"):
        opened(0, 10, 20, 40, 50, time_step=1e-5)
    with pytest.warns(UserWarning, match=r"f_010\.npy comes after f_10\.npy"):
        opened(0, 10, "010", 20, 30, time_step=1e-5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        opened(0, 10, 20, 40, time=[0.0, 1e-5, 2e-5, 4e-5])
        opened(5, 10, 15, time_step=1e-5)
        opened("0.1", "0.15", "0.2", time_step=1e-5)
        opened("a", "b", "c7", time_step=1e-5)
        opened("9", "77", time_step=1e-5)


def test_collections_and_cases_have_their_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A .pvd file, and an OpenFOAM case of which the reader is asked for one time; options go to it."""
    asked = []

    def read(path: Path, time=None, **options) -> DensityField:
        asked.append((path.name, time, options))
        return flow.GridDensity(np.full((4, 5, 6), 0.6), [0, 0, 0], [1e-3] * 3, "volume", 0.5)

    def kept(reader, path: Path, **more) -> DensityField:  # what `flow.read` and `flow.Reader` share
        return read(path, **{**reader.options, **more})

    monkeypatch.setattr(flow.Reader, "__call__", kept)
    for name in ("b.vtu", "a.vtu"):
        (tmp_path / name).write_text("")
    lines = [f'<DataSet timestep="{t}" file="{name}"/>' for t, name in ((2e-5, "b.vtu"), (1e-5, "a.vtu"))]
    (tmp_path / "run.pvd").write_text(f"<VTKFile><Collection>{''.join(lines)}</Collection></VTKFile>")
    series = flow.open_series(tmp_path / "run.pvd", length_unit="mm")
    assert list(series.time) == [1e-5, 2e-5] and series.mesh.shape == (4, 5, 6)
    series.density(1)
    around = {"ambient_density": 0.5}  # of the first one, for all
    assert asked == [("a.vtu", None, {"length_unit": "mm"}), ("b.vtu", None, {"length_unit": "mm"} | around)]
    for folder in ("system", "constant/polyMesh", "0", "0.002", "0.0005"):
        (tmp_path / "case" / folder).mkdir(parents=True)
        (tmp_path / "case" / folder / "rho").write_text("")
    case = flow.open_series(tmp_path / "case", density="rho")
    assert list(case.time) == [0.0, 0.0005, 0.002] and isinstance(case[1], DensityField)
    assert asked[-1] == ("case", 0.0005, {"density": "rho"} | around)
    (tmp_path / "bad.pvd").write_text("<VTKFile>")
    with pytest.raises(ValueError, match="not a list of data sets"):
        flow.open_series(tmp_path / "bad.pvd")


def test_a_file_of_several_times_is_read_at_each(tmp_path: Path):
    """A Tecplot file and NumPy arrays over time. Expected: their times, and the densities at each."""
    x, y = np.linspace(0.0, 2.0, 3), np.linspace(0.0, 1.0, 2)
    density = 1.0 + 0.1 * np.arange(3.0)[:, None, None] + x[:, None] + 0.0 * y
    np.savez(tmp_path / "a.npz", time=[0.5, 1.5, 2.5], x=x, y=y, rho=density)
    lines = ["VARIABLES = X Y rho"]
    for time, values in zip((0.5, 1.5, 2.5), density, strict=True):
        lines.append(f"ZONE I=3, J=2, STRANDID=1, SOLUTIONTIME={time}, F=POINT")
        lines += [f"{x[i]} {y[j]} {values[i, j]:.17g}" for j in range(2) for i in range(3)]
    (tmp_path / "a.dat").write_text("\n".join(lines))
    for name in ("a.npz", "a.dat"):
        series = flow.open_series(tmp_path / name)
        assert list(series.time) == [0.5, 1.5, 2.5]
        assert series[1].density_at([[0.0, 0.5, -0.5]]) == pytest.approx(1.6, rel=1e-12)
    (tmp_path / "once.dat").write_text("\n".join(lines[:8]).replace("SOLUTIONTIME=0.5", ""))
    with pytest.raises(ValueError, match=r"once.dat: it states no times: open a series from a list or a pattern"):
        flow.open_series(tmp_path / "once.dat")


@pytest.mark.parametrize(
    ("source", "options", "words"),
    [
        ([], {"time": []}, "empty"),
        (arrays(), {}, "time_step"),
        (arrays(), {"time": [0.0, 1.0]}, "2 times for 3"),
        (arrays(), {"time": [0.0, 2.0, 1.0]}, "must increase"),
        (arrays(), {"time": TIME, "geometry": None}, "geometry"),
        (arrays(), {"time": TIME, "ambient_density": None}, "ambient_density"),
        (arrays(), {"time": TIME, "spacing": [1e-3, 0.0, 1e-3]}, "spacing"),
        (iter(arrays()), {"time_step": 1e-5}, "count"),
        (arrays(), {"time": TIME, "density": "rho"}, "the list is taken for arrays, which take no density, but time"),
        (arrays(), {"start_time": 1.0}, "start_time=1.0 goes with time_step"),
        (arrays(), {"time": TIME, "count": 4}, "count=4, but the source has 3 snapshots"),
        (arrays(), {"time": TIME, "mesh": square_mesh()}, "the list is planar, not volume: leave geometry out"),
        (arrays(), {"time": TIME, "geometry": None, "mesh": square_mesh()}, "give mesh, or origin and what"),
    ],
)
def test_what_makes_no_series_of_arrays_is_refused(source, options, words):
    with pytest.raises(ValueError, match=words):
        flow.open_series(source, **{**GRID, **options})


@pytest.mark.parametrize(
    ("source", "options", "words"),
    [
        ("nothing_*.vtu", {"time": TIME}, "no file matches"),
        ("nothing.nc", {}, "no such file"),
        ("tests", {}, "no Zarr store"),
        (["nothing.vtu"], {"time": [0.0]}, "no such file"),
        (dataset().rename(rho="temperature"), {"density": None}, "temperature"),
        (dataset().rename(time="instant"), {}, "no time"),
        (dataset().rename(x="u"), {}, "rename"),
        (dataset("kg"), {}, "length"),
        (dataset(), {"origin": [0, 0, 0]}, "xarray object is taken for data with a time axis, which take no origin"),
        (dataset(), {"geometry": "planar"}, "xarray object is volume, not planar: leave geometry out"),
        (dataset(), {"count": 2}, "count=2, but the source has 3 snapshots"),
        (dataset(), {"density": {"pressure": "p", "temperature": "T"}}, "give density=NAME"),
        ("nothing_*.vtu", {"cell_averages": True}, "taken for files that are read one by one, which take no cell_aver"),
        (["nothing.vtu"], {"mesh": square_mesh()}, "the list of paths is taken for files .* take no QuadMesh"),
        (["nothing.vtu"], {"origin": [0, 0, 0]}, "which take no origin, but time, .* and options of their reader"),
        ([flow.wedge(2.0, 0.1)], {"time": [0.0], "ambient_density": 1.0}, "is a formula, which has its own ambient"),
    ],
)
def test_what_makes_no_series_of_files_is_refused(source, options, words):
    with pytest.raises(ValueError, match=words):
        flow.open_series(source, **options)


def test_times_that_a_caller_gives_replace_those_of_a_file():
    """Such as numbers of steps, which a file calls its time; they were ignored."""
    assert np.allclose(flow.open_series(dataset(), time_step=1e-3, start_time=0.5).time, [0.5, 0.501, 0.502])
    assert flow.open_series(dataset(), time=[1.0, 2.0, 4.0]).time.tolist() == [1.0, 2.0, 4.0]
    with pytest.raises(ValueError, match="2 times for 3 snapshots"):
        flow.open_series(dataset(), time=[1.0, 2.0])


def test_files_with_falling_axes_and_of_the_classic_form(tmp_path: Path):
    plain = dataset()
    plain["rho"] = plain.rho + xarray.DataArray(0.01 * np.arange(6), dims="z")
    turned = plain.isel(z=slice(None, None, -1), x=slice(None, None, -1))
    turned.to_netcdf(tmp_path / "a.nc", engine="scipy")
    expected = flow.open_series(plain)
    for series in (flow.open_series(turned), flow.open_series(tmp_path / "a.nc")):
        assert np.array_equal(series.mesh.origin, expected.mesh.origin)
        assert np.array_equal(series.density(1), expected.density(1))


@pytest.mark.parametrize(
    ("engine", "lost"),
    [("scipy", "short"), ("h5netcdf", "gone"), ("scipy", "other"), ("h5netcdf", "other"), ("scipy", "a folder")],
)
def test_a_file_that_changes_while_a_series_is_read_is_refused(
    tmp_path: Path, engine: str, lost: str, monkeypatch: pytest.MonkeyPatch
):
    """A file of the classic form that was cut short ended the process; values of two files came into one series."""
    monkeypatch.setattr(netcdf_reading, "SMALL", 0.0)  # what is larger is read when it is asked for
    path = tmp_path / "a.nc"
    dataset().to_netcdf(path, engine=engine)
    series = flow.open_series(path)
    series.density(0)
    if lost == "short":
        os.truncate(path, 100)
    else:
        path.unlink()
    if lost == "other":
        (2.0 * dataset()).assign_attrs(dataset().attrs).to_netcdf(path, engine=engine)
    if lost == "a folder":
        path.mkdir()
    with pytest.raises(
        ValueError, match=r"a\.nc: it (has changed since it was opened|was opened, but no longer exists)"
    ):
        series.density(1)


def test_a_path_with_brackets_is_no_pattern(tmp_path: Path):
    dataset().to_netcdf(tmp_path / "run[1].nc", engine="h5netcdf")
    assert len(flow.open_series(tmp_path / "run[1].nc")) == 3
