"""Fields and rays in VTK files, read again by VTK's own readers."""

import numpy as np
import pytest

from aerokernels import Disc, IndexField, QuadMesh, RayBundle, field_to_vtk, rays_to_vtk, trace

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


def test_a_mesh_keeps_its_cells(tmp_path):
    y, z = np.meshgrid(np.linspace(0.0, 1.0, 4), np.linspace(0.0, 2.0, 5), indexing="ij")
    field = IndexField.from_mesh(QuadMesh.structured(y, z + 0.2 * y, "planar"), 1e-4 * y)
    data, place, arrays = read(field_to_vtk(field, tmp_path / "mesh.vtu"), "UnstructuredGrid")
    assert data.GetNumberOfCells() == 12 and arrays["contrast"] == pytest.approx(1e-4 * place[:, 1], abs=1e-18)


def test_rays_are_polylines(tmp_path):
    """The last points are where `trace` ends on the same plane."""
    y = np.linspace(-0.1, 0.1, 9)
    field = IndexField.from_samples(
        np.repeat(1e-3 * y[:, None], 9, axis=1), origin=(-0.1, 0.0), spacing=(0.025, 0.025), geometry="planar"
    )
    rays = RayBundle.collimated(Disc(0.01, center=(0.0, 0.0, -0.1)), 8)
    data, place, arrays = read(rays_to_vtk(field, rays, tmp_path / "rays", length=0.4, point_count=5), "PolyData")
    assert data.GetNumberOfLines() == rays.ray_count and len(place) == 5 * rays.ray_count
    from aerokernels import Plane

    ends = trace(field, rays, until=Plane((0.0, 0.0, 0.3), (0.0, 0.0, 1.0)))
    assert place.reshape(-1, 5, 3)[:, -1] == pytest.approx(ends.position, abs=1e-9)
    assert arrays["opd"].reshape(-1, 5)[:, -1] == pytest.approx(ends.opd, abs=1e-12)
    with pytest.raises(ValueError, match="length"):
        rays_to_vtk(field, rays, tmp_path / "rays", length=0.0)
