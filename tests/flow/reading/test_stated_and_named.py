"""What files state in unusual but legal ways: units, names, groups, coordinates, packing, order of rows.

Expected: what is read is what the file says, or an error that names what is ambiguous; never other numbers.
"""

import h5py
import numpy as np
import pytest
import writers

from aerokernels import flow

X, Y = np.linspace(0.0, 0.1, 9), np.linspace(0.0, 0.05, 6)
RHO = 1.2 + 0.3 * X[:, None] + 0.2 * Y


def hdf5(path, arrays, attributes=()):
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[name] = values
        for name, key, value in attributes:
            file[name].attrs[key] = value
    return path


@pytest.mark.parametrize(
    "stated",
    [
        ("units", np.array([b"mm"]), np.array([b"g/cm3"])),
        ("units", np.array(["mm"], h5py.string_dtype()), np.array(["g/cm3"], h5py.string_dtype())),
        ("unit", "mm", "g/cm3"),
        ("Units", b"mm", b"g/cm3"),
    ],
    ids=["bytes", "texts", "unit", "Units"],
)
def test_units_of_hdf5_arrays_are_heeded_however_they_are_stated(tmp_path, stated):
    key, length, density = stated
    arrays = {"x": 1e3 * X, "y": 1e3 * Y, "rho": 1e-3 * RHO}
    file = hdf5(tmp_path / "a.h5", arrays, [("x", key, length), ("y", key, length), ("rho", key, density)])
    field = flow.read(file)
    assert np.ptp(field.mesh.vertices, axis=0) == pytest.approx([0.05, 0.1])
    assert np.sort(field.density) == pytest.approx(np.sort(RHO.ravel()))


def test_arrays_of_one_name_in_several_groups_are_not_chosen_silently(tmp_path):
    file = hdf5(tmp_path / "a.h5", {"x": X, "y": Y, "t1/rho": RHO, "t2/rho": 2.0 * RHO})
    with pytest.raises(ValueError, match="several groups have such an array: t1/rho, t2/rho: name one"):
        flow.read(file)
    assert flow.read(file, density="t2/rho").density.min() == pytest.approx(2.0 * RHO.min())


def test_an_absolute_pressure_counts_before_one_relative_to_an_operating_pressure(tmp_path):
    """Set-up: a table as Fluent writes it, with the gauge pressure and the absolute one. Expected: p / (R T)."""
    x, y = (axis.ravel() for axis in np.meshgrid(X, Y))
    gauge, temperature = 5e4 + 1e4 * x, 300.0 + y
    columns = np.stack([x, y, gauge, gauge + 101325.0, temperature], 1)
    names = "x-coordinate,y-coordinate,pressure,absolute-pressure,temperature"
    np.savetxt(tmp_path / "a.csv", columns, delimiter=",", header=names, comments="")
    field = flow.read(tmp_path / "a.csv", gas_constant=287.0)
    at = field.mesh.vertices
    expected = (5e4 - 1e4 * at[:, 1] + 101325.0) / (287.0 * (300.0 + at[:, 0]))
    assert field.density == pytest.approx(expected, rel=1e-12)


def tecplot(path, names, head, columns, block=False):
    rows = columns if block else np.transpose(columns)
    lines = [f"VARIABLES = {' '.join(names)}", head, *(" ".join(map(repr, map(float, row))) for row in rows)]
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(("names", "axis"), [(("x", "r"), "-x"), (("z", "r"), "+z")])
def test_tecplot_of_a_radius_is_axisymmetric(tmp_path, names, axis):
    x, y = np.meshgrid(X, Y)
    file = tecplot(tmp_path / "a.dat", [*names, "rho"], "ZONE I=9, J=6, F=POINT", [x.ravel(), y.ravel(), RHO.T.ravel()])
    field = flow.read(file)
    assert field.mesh.geometry == "axisymmetric"
    assert f"axisymmetric, z along {axis} of the file" in field.provenance


def test_tecplot_that_does_not_state_its_packing(tmp_path):
    """Expected: with one point a line it is POINT; with other lines it could be either, and the error says so."""
    x, y = np.meshgrid(X, Y)
    columns = [x.ravel(), y.ravel(), RHO.T.ravel()]
    names, head = ["x", "y", "rho"], "ZONE I=9, J=6"
    field = flow.read(tecplot(tmp_path / "point.dat", names, head, columns))
    assert np.sort(field.density) == pytest.approx(np.sort(RHO.ravel()), rel=1e-15)
    with pytest.raises(ValueError, match=r"does not state DATAPACKING, and its first line has 54 of 3 variables"):
        flow.read(tecplot(tmp_path / "block.dat", names, head, columns, block=True))
    stated = tecplot(tmp_path / "stated.dat", names, f"{head}, DATAPACKING=BLOCK", columns, block=True)
    assert (flow.read(stated).density == field.density).all()


def test_rows_of_a_text_restart_of_su2_are_put_in_the_order_of_its_points(tmp_path):
    """Set-up: a restart with PointID and no coordinates, its rows shuffled. Expected: as before the shuffle."""
    expected = flow.read(writers.su2(tmp_path, binary=True))
    (su2,) = tmp_path.glob("*.su2")
    for other in tmp_path.iterdir():
        if other != su2:
            other.unlink()
    x, y = writers.grid()
    order = np.random.default_rng(3).permutation(x.size)
    rows = np.stack([order, writers.rho(x, y).ravel()[order]], 1)
    np.savetxt(tmp_path / "restart.csv", rows, delimiter=",", header='"PointID","Density"', comments="", fmt="%.17g")
    assert (flow.read(tmp_path / "restart.csv").density == expected.density).all()
    rows[0, 0] = rows[1, 0]
    np.savetxt(tmp_path / "restart.csv", rows, delimiter=",", header='"PointID","Density"', comments="", fmt="%.17g")
    with pytest.raises(ValueError, match="PointID does not number the 651 points from 0 on"):
        flow.read(tmp_path / "restart.csv")


def test_the_latest_of_times_in_any_order_is_read(tmp_path):
    """Set-up: fields at 0.3, 0.1 and 0.2 s. Expected: "latest" is 0.3; a time twice and NaN are refused."""
    fields = np.array([3.0, 1.0, 2.0])[:, None, None] * np.ones((9, 6))

    def read(times, **asked):
        np.savez(tmp_path / "a.npz", x=X, y=Y, time=times, rho=fields)
        return flow.read(tmp_path / "a.npz", **asked)

    times = np.array([0.3, 0.1, 0.2])
    read(times)
    assert flow.contents(tmp_path / "a.npz").times == (0.1, 0.2, 0.3)
    for asked, density in (("latest", 3.0), ("first", 1.0), (0.2, 2.0)):
        assert read(times, time=asked).density == pytest.approx(density)
    twice = np.array([0.3, 0.1, 0.3])
    assert read(twice, time="first").density == pytest.approx(1.0)
    with pytest.raises(flow.ReadError, match=r"it has 2 fields at the time 0\.3, as after a restart: keep one of them"):
        read(twice)
    with pytest.raises(flow.ReadError, match="1 of its 3 times are no numbers, the first is number 1"):
        read(np.array([0.3, np.nan, 0.4]))


@pytest.mark.parametrize("told_by", ["scale", "label"])
def test_axes_that_an_hdf5_file_names_are_heeded(tmp_path, told_by):
    """Set-up: a square of nine places each way, the density over (y, x) by its dimension scales or labels.

    Expected: as named. It was taken over (x, y), although the file says otherwise.
    """
    x = np.linspace(0.0, 1.0, 9)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"], file["y"], file["rho"] = x, x, 1.2 + 0.3 * x + 0.2 * x[:, None]
        for number, axis in enumerate("yx"):
            if told_by == "label":
                file["rho"].dims[number].label = axis
            else:
                file[axis].make_scale(axis)
                file["rho"].dims[number].attach_scale(file[axis])
    at = np.array([[0.0, 0.25, -0.75]])
    assert flow.read(tmp_path / "a.h5").density_at(at) == pytest.approx(1.2 + 0.3 * 0.75 + 0.2 * 0.25)


def test_packed_hdf5_arrays_are_unpacked(tmp_path):
    """Set-up: whole numbers with scale_factor and add_offset, as NetCDF packs. Expected: the density."""
    packed = np.round((RHO - 1.2) / 1e-4).astype(np.int16)
    attributes = [("rho", "scale_factor", 1e-4), ("rho", "add_offset", np.array([1.2])), ("rho", "_FillValue", -1)]
    file = hdf5(tmp_path / "a.h5", {"x": X, "y": Y, "rho": packed + 5}, attributes)
    assert np.sort(flow.read(file).density.ravel()) == pytest.approx(np.sort(RHO.ravel()) + 5e-4, abs=6e-5)


def test_a_time_in_single_precision_is_found(tmp_path):
    """Set-up: times in float32. Expected: 0.1 is found; "there is no time 0.1: take one of 0.1" was the answer."""
    fields = np.array([3.0, 1.0])[:, None, None] * np.ones((9, 6))
    np.savez(tmp_path / "a.npz", x=X, y=Y, time=np.array([0.1, 0.1001], np.float32), rho=fields)
    assert flow.read(tmp_path / "a.npz", time=0.1).density == pytest.approx(3.0)
    with pytest.raises(flow.ReadError, match=r"there is no time 0\.10001"):
        flow.read(tmp_path / "a.npz", time=0.10001)
