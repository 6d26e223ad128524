"""Fields and rays in VTK files, read again by VTK's own readers."""

import numpy as np
import pytest

from aerokernels import ArcLength, Disc, IndexField, Plane, RayBundle, field_to_vtk, rays_to_vtk, trace

pytest.importorskip("vtkmodules")


def read(path, kind: str):
    import vtkmodules.all as vtk
    from vtkmodules.util.numpy_support import vtk_to_numpy

    reader = getattr(vtk, f"vtkXML{kind}Reader")()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    values = data.GetPointData()
    arrays = {values.GetArrayName(i): vtk_to_numpy(values.GetArray(i)) for i in range(values.GetNumberOfArrays())}
    place = np.array([data.GetPoint(i) for i in range(data.GetNumberOfPoints())])
    return data, place, arrays


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_a_grid_keeps_places_and_values(tmp_path, geometry: str):
    """Contrast at the points of the file is that of the field there."""
    shape = (4, 5, 6) if geometry == "volume" else (5, 6)
    contrast = 1e-4 * np.random.default_rng(2).random(shape)
    field = IndexField.from_samples(
        contrast, origin=[0.0] * len(shape), spacing=[0.1, 0.2, 0.3][: len(shape)], geometry=geometry, ambient_index=1.1
    )
    path = field_to_vtk(field, tmp_path / "field")
    _, place, arrays = read(path, "ImageData")
    assert path.suffix == ".vti" and len(place) == contrast.size
    assert arrays["contrast"] == pytest.approx(field.contrast_at(place), abs=1e-15)
    assert arrays["index"] - 1.1 == pytest.approx(arrays["contrast"], abs=1e-15)


def test_rays_are_polylines(tmp_path):
    """The last points are where `trace` ends on the same plane."""
    y = np.linspace(-0.1, 0.1, 9)
    field = IndexField.from_samples(
        np.repeat(1e-3 * y[:, None], 9, axis=1), origin=(-0.1, 0.0), spacing=(0.025, 0.025), geometry="planar"
    )
    rays = RayBundle.collimated(Disc(0.01, center=(0.0, 0.0, -0.1)), 8)
    stop = Plane((0.0, 0.0, 0.3), (0.0, 0.0, 1.0))
    data, place, arrays = read(rays_to_vtk(field, rays, tmp_path / "rays", until=stop, point_count=5), "PolyData")
    assert data.GetNumberOfLines() == rays.ray_count and len(place) == 5 * rays.ray_count
    ends = trace(field, rays, until=stop)
    assert place.reshape(-1, 5, 3)[:, -1] == pytest.approx(ends.position, abs=1e-9)
    assert arrays["opd"].reshape(-1, 5)[:, -1] == pytest.approx(ends.opd, abs=1e-12)
    assert np.ptp(place.reshape(-1, 5, 3)[0, :, 2]) == pytest.approx(0.4) and place[1, 2] == pytest.approx(0.0)
    back = rays_to_vtk(field, rays, tmp_path / "same", until=Plane(stop.point, -stop.normal), point_count=5)
    assert np.array_equal(read(back, "PolyData")[1], place)
    length = ArcLength(0.35)
    _, place, arrays = read(rays_to_vtk(field, rays, tmp_path / "arc", until=length, point_count=8), "PolyData")
    ends, steps = trace(field, rays, until=length), np.diff(place.reshape(-1, 8, 3), axis=1)
    assert place.reshape(-1, 8, 3)[:, -1] == pytest.approx(ends.position, abs=1e-9)
    assert np.linalg.norm(steps, axis=2) == pytest.approx(0.05, rel=1e-5)
    for wrong in ({"until": 5e-3}, {"outputs": ("opd",)}):
        with pytest.raises(TypeError, match=r"until|outputs"):
            rays_to_vtk(field, rays, tmp_path / "rays", **wrong)


def test_a_ray_stays_where_it_met_a_body(tmp_path):
    """A square rod, between two of the planes that rays are followed to: on its face, with the OPD up to there."""
    from aerokernels.medium import Body

    y = np.linspace(-3e-3, 3e-3, 61)
    rod = Body([[-5e-4, -5e-4], [5e-4, -5e-4], [5e-4, 5e-4], [-5e-4, 5e-4]], "planar")
    contrast = 1e-4 * np.exp(-(y[:, None] ** 2 + y**2) / 2e-6)
    field = IndexField.from_samples(contrast, origin=(y[0], y[0]), spacing=(1e-4, 1e-4), geometry="planar", body=rod)
    rays = RayBundle([[0.0, 0.0, -2e-3], [0.0, 1e-3, -2e-3]], [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    _, place, arrays = read(rays_to_vtk(field, rays, tmp_path / "rays", point_count=8), "PolyData")
    ends = trace(field, rays)
    assert place[:, 2].reshape(2, 8)[0, 3:] == pytest.approx(-5e-4, abs=1e-8)
    assert arrays["opd"].reshape(2, 8)[0, -1] == pytest.approx(ends.opd[0], rel=1e-3)
    assert 3e-3 < place[15, 2] < 4e-3
