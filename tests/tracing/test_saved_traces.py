"""A saved trace is opened with all it had: arrays, status, errors; rays in a linear medium as the example."""

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Plane, RayBundle, TraceResult, flow, trace


@pytest.fixture(scope="module")
def field() -> IndexField:
    y, z = np.linspace(-2e-3, 2e-3, 33), np.linspace(0.0, 1e-2, 65)
    contrast = 1e-4 * np.sin(900.0 * y[:, None]) * np.exp(-((z / 4e-3) ** 2))
    return IndexField.from_samples(contrast, origin=(y[0], z[0]), spacing=(1.25e-4, 1.5625e-4), geometry="planar")


@pytest.mark.parametrize("outputs", [None, ("opd",), ("direction",)])
def test_a_saved_trace_is_opened(tmp_path, field: IndexField, outputs):
    rays = RayBundle.collimated(Disc(1e-3, center=(0.0, 0.0, -1e-3)), 64)
    made = trace(field, rays, until=Plane((0.0, 0.0, 0.02), (0.0, 0.1, 1.0)), outputs=outputs)
    made.to_xarray().to_netcdf(tmp_path / "rays.nc")
    found = TraceResult.open(tmp_path / "rays.nc")
    assert found.to_xarray().equals(made.to_xarray()) and found.wavelength == made.wavelength
    assert found.ray_count == 64 and found.status_summary() == made.status_summary() == {"OK": 64}
    assert str(found.plan) == str(made.plan) and (found.opd is None) == (outputs == ("direction",))
    if outputs != ("direction",):
        assert found.error == made.error and found.error["total"] > 0.0
        assert found.quantities == made.quantities and repr(found).splitlines()[:2] == repr(made).splitlines()[:2]
    if outputs is None:
        assert np.array_equal(found.ends[0], made.ends[0]) and found.on_device("opd") is not None


def test_what_a_cut_leaves_out_is_saved_too(tmp_path):
    whole = flow.shipped("mach3").index_field(wavelength=905e-9)
    part = whole.resample(2e-4, region=((0, -9e-3), (5e-3, 0.0)))
    rays = RayBundle.collimated(Disc(2e-3, center=(0.0, 0.0, -8e-3)), 16)
    made = trace(part, rays)
    assert set(made.status_summary()) == {"LEFT_DISTURBED_AIR"}
    made.to_xarray().to_netcdf(tmp_path / "rays.nc")
    found = TraceResult.open(tmp_path / "rays.nc")
    assert found.status_summary() == made.status_summary() and found.ok.all()
    assert np.array_equal(found.truncation, made.truncation) and np.array_equal(found.group_path, made.group_path)


def test_other_files_are_refused(tmp_path, field: IndexField):
    made = trace(field, RayBundle.collimated(Disc(1e-3, center=(0.0, 0.0, -1e-3)), 8))
    made.to_xarray().drop_vars("status").to_netcdf(tmp_path / "other.nc")
    (tmp_path / "torn.nc").write_bytes(b"not a file of this kind")
    for name in ("other.nc", "torn.nc", "none.nc"):
        with pytest.raises(ValueError, match=name):
            TraceResult.open(tmp_path / name)
