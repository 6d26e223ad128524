"""Units that CGNS files state: of coordinates and densities, for all of a base or one array, and of none."""

import numpy as np
import pytest

from aerokernels import flow

pytest.importorskip("h5py")
pytest.importorskip("vtkmodules")
import cgns_writer
import h5py


def words(*units: str) -> str:
    return "".join(unit.ljust(32) for unit in units)


IMPERIAL = words("Slug", "Foot", "Second", "Rankine", "Radian")
METRIC = words("Gram", "Millimeter", "Second", "Kelvin", "Degree")


def plane(tmp_path, *more):
    y, x = np.meshgrid(np.linspace(0.0, 1.0, 6), np.linspace(0.0, 2.0, 9), indexing="ij")
    return cgns_writer.cgns(tmp_path / "a.cgns", (x, y), 1e-6 * (1.0 + 0.1 * y), [], more=more)


@pytest.mark.parametrize(
    ("more", "length", "density"),
    [
        ([("U", "DimensionalUnits_t", IMPERIAL)], 0.3048, 515.3788183931964),
        ([("C", "DataClass_t", "Dimensional"), ("U", "DimensionalUnits_t", METRIC)], 1e-3, 1e6),
        ([("C", "DataClass_t", "NormalizedByUnknownDimensional"), ("U", "DimensionalUnits_t", METRIC)], 1.0, 1.0),
        ([], 1.0, 1.0),
    ],
)
def test_units_of_a_base(tmp_path, more, length, density):
    """Set-up: a plane 2 wide, 1 high, of 1e-6 to 1.1e-6. Expected: in metres and kg/m3, unless data have no unit."""
    path = plane(tmp_path, *more)
    found = flow.read(path)
    assert np.ptp(found.box[0] - found.box[1]) == pytest.approx(length, rel=1e-12)
    assert found.density.min() == pytest.approx(1e-6 * density, rel=1e-12)
    stated = flow.read(path, length_unit="m", reference={"density": 1.0})
    assert np.ptp(stated.box[0] - stated.box[1]) == pytest.approx(1.0, rel=1e-12)
    assert stated.density.min() == pytest.approx(1e-6, rel=1e-12)


def test_units_of_one_array(tmp_path):
    """Set-up: a base in feet and slugs, whose density has units and exponents of its own, g/mm3. Expected: these."""
    path = plane(tmp_path, ("U", "DimensionalUnits_t", IMPERIAL))
    with h5py.File(path, "r+", track_order=True) as file:
        own = file["Base/Zone/Flow/Density"]
        cgns_writer.node(own, "U", "DimensionalUnits_t", METRIC)
        cgns_writer.node(own, "E", "DimensionalExponents_t", np.array([1.0, -3.0, 0.0, 0.0, 0.0]))
    found = flow.read(path)
    assert found.density.min() == pytest.approx(1.0, rel=1e-12)
    assert np.ptp(found.box[0] - found.box[1]) == pytest.approx(0.3048, rel=1e-12)


def test_bases_that_hold_the_same_zone_are_refused(tmp_path):
    """Set-up: a second base with a zone of one name, as CFX writes moments. Expected: refused by the zone's name."""
    path = plane(tmp_path)
    assert flow.read(path, reference={"density": 1e6}).density.size
    with h5py.File(path, "a") as file:
        file.copy("Base", "Base 2")
        file["Base 2"].attrs.modify("name", file["Base"].attrs["name"].replace(b"Base", b"Base 2"))
    with pytest.raises(ValueError, match=r"2 of its bases contain a zone '\w+.*write each base to a file of its own"):
        flow.read(path, reference={"density": 1e6})
