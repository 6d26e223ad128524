"""Write fields and rays as VTK files for ParaView: image data or unstructured grids, and polylines.

VTK's own writers are used (the extra `cfd`). Coordinates are metres in the frame of the package; a planar field is in
the plane x = 0, an axisymmetric one in the half plane y = 0, x > 0, with its radius along x.
"""

from pathlib import Path

import numpy as np

from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import check_count
from aerokernels.inputs.kinds import wrong_kind
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane, RayStatus, trace
from aerokernels.tracing.stop import reached, way_beyond


@checked
def field_to_vtk(field: IndexField, path: str | Path) -> Path:
    """Write a field: "contrast" and "index" at its nodes, .vti from a uniform grid and .vtu from a mesh.

    Returns:
        The path written to, with the ending that ParaView needs.

    Raises:
        ImportError: VTK is not installed.
        TypeError: `field` is no IndexField.
        ValueError: The path's folder does not exist.
    """
    if not isinstance(field, IndexField):
        raise wrong_kind(field, "field", "an IndexField")
    vtk = _vtk()
    if field.is_uniform:
        values = np.asarray(field.samples.samples, dtype=np.float64)  # type: ignore[union-attr]
        low, spacing = np.asarray(field.samples.low), np.asarray(field.spacing)
        if (across := {"planar": 0, "axisymmetric": 1}.get(field.geometry)) is not None:
            values, low = np.expand_dims(values, across), np.insert(low, across, 0.0)
            spacing = np.insert(spacing, across, spacing.min())
        data = vtk.vtkImageData()
        data.SetDimensions(*values.shape)
        data.SetOrigin(*low)
        data.SetSpacing(*spacing)
        contrast = values.ravel(order="F")
    else:
        mesh = field.mesh
        place = np.zeros((len(mesh.vertices), 3))
        place[:, 1 if field.geometry == "planar" else 0], place[:, 2] = mesh.vertices.T
        data = vtk.vtkUnstructuredGrid()
        data.SetPoints(_points(place, vtk))
        cells = vtk.vtkCellArray()
        cells.SetData(4, _array(np.ascontiguousarray(mesh.cells, dtype=np.int64).ravel()))
        data.SetCells(vtk.VTK_QUAD, cells)
        contrast = np.asarray(field.samples.values, dtype=np.float64).ravel()  # type: ignore[union-attr]
    arrays = {"contrast": contrast, "index": field.ambient_index + contrast}
    return _write(data, arrays, Path(path), ".vti" if field.is_uniform else ".vtu", vtk)


@checked
def rays_to_vtk(
    field: IndexField,
    rays: RayBundle,
    path: str | Path,
    *,
    until: Plane | ArcLength | None = None,
    point_count: int = 33,
    **options,
) -> Path:
    """Write the paths of rays through a field as polylines (.vtp), with the OPD [m] accumulated up to each point.

    Rays are traced to evenly spaced stops before the last one; a ray that ends stays where it ended.

    Args:
        field: The refractive index.
        rays: The rays; some hundreds are enough for a picture.
        path: The file.
        until: The last stop, a `Plane` or an `ArcLength` as for `trace`; None takes the plane across the bundle's mean
            direction beyond the field.
        point_count: Points of each polyline.
        **options: As for `trace`, except `outputs`.

    Returns:
        The path written to.

    Raises:
        ImportError: VTK is not installed.
        TypeError: An argument of the wrong kind, or an unknown option of `trace`.
        ValueError: A number that makes no sense, rays without a mean direction where it is needed, or as for `trace`.
    """
    check_count(point_count, "point_count", 2)
    vtk = _vtk()
    along = rays.direction.mean(axis=0)
    if until is None:
        if not np.linalg.norm(along) > 1e-6:
            raise ValueError("the rays' directions have no mean: give until=, or write those of either way alone")
        along, middle = along / np.linalg.norm(along), rays.position.mean(axis=0)
        reach = float(np.linalg.norm(rays.position - middle, axis=1).max())
        until = Plane(middle + way_beyond(field.box, middle, reach, along) * along, along)
    place = np.full((point_count, rays.ray_count, 3), np.nan)
    opd = np.zeros((point_count, rays.ray_count))
    place[0] = rays.position
    for number in range(1, point_count):
        share, ahead = number / (point_count - 1), np.full(rays.ray_count, True)
        if isinstance(until, Plane):
            normal = until.normal if along @ until.normal >= 0.0 else -until.normal
            height = (until.point - rays.position) @ normal
            stop: Plane | ArcLength = Plane(until.point - (1.0 - share) * height.max() * normal, normal)
            ahead = height > (1.0 - share) * height.max()
        else:
            stop = ArcLength(share * until.length)
        place[number], opd[number] = place[number - 1], opd[number - 1]
        found = trace(field, rays, until=stop, outputs=("position", "opd"), **options)
        assert found.position is not None and found.opd is not None  # requested outputs
        known = (reached(found.traced_status) | (found.traced_status == RayStatus.HIT_BODY)) & ahead
        place[number, known], opd[number, known] = found.position[known], found.opd[known]
    data = vtk.vtkPolyData()
    order = np.moveaxis(place, 0, 1).reshape(-1, 3)
    data.SetPoints(_points(order, vtk))
    lines = vtk.vtkCellArray()
    ids = np.arange(len(order), dtype=np.int64)
    offsets = point_count * np.arange(rays.ray_count + 1, dtype=np.int64)
    lines.SetData(_array(offsets), _array(ids))
    data.SetLines(lines)
    return _write(data, {"opd": np.moveaxis(opd, 0, 1).ravel()}, Path(path), ".vtp", vtk)


def _vtk():
    try:
        import vtkmodules.all as vtk
    except ImportError:
        raise ImportError("VTK is not installed: pip install aerokernels[cfd]") from None
    return vtk


def _array(values: np.ndarray):
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

    if values.dtype == np.int64:
        return numpy_to_vtkIdTypeArray(values, deep=True)
    return numpy_to_vtk(np.ascontiguousarray(values), deep=True)


def _points(place: np.ndarray, vtk):
    points = vtk.vtkPoints()
    points.SetData(_array(np.ascontiguousarray(place)))
    return points


def _write(data, arrays: dict[str, np.ndarray], path: Path, ending: str, vtk) -> Path:
    for name, values in arrays.items():
        array = _array(values)
        array.SetName(name)
        data.GetPointData().AddArray(array)
    kind = {".vti": "vtkXMLImageDataWriter", ".vtu": "vtkXMLUnstructuredGridWriter", ".vtp": "vtkXMLPolyDataWriter"}
    path = path if path.suffix == ending else path.with_name(path.name + ending)
    if not path.parent.is_dir():  # VTK would print its own errors
        raise ValueError(f"{path}: there is no folder {path.parent}; make it, or choose another path")
    writer = getattr(vtk, kind[ending])()
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    if not writer.Write():
        raise OSError(f"{path} could not be written")
    return path
