"""Names and units of coordinates, as files and arrays call them."""

from ...units import quantity

# In lower case and without blanks, signs and units.
COLUMNS = {
    "x": ("x", "points0", "coordinatex", "centersx", "ccx", "xcoordinate", "posx", "positionx"),
    "y": ("y", "points1", "coordinatey", "centersy", "ccy", "ycoordinate", "posy", "positiony"),
    "z": ("z", "points2", "coordinatez", "centersz", "ccz", "zcoordinate", "posz", "positionz"),
    "r": ("r", "radius"),
}
INCHES = {"in": 0.0254, "inch": 0.0254, "ft": 0.3048}
METRES = {"", "m", "meter", "metre", "meters", "metres", "1", "dimensionless"}


def metres(unit: str) -> float:
    """A unit of length as a file's attribute names it, in metres; none is metres.

    Raises:
        ValueError: No unit of length.
    """
    unit = unit.strip()
    if unit.lower() in METRES:
        return 1.0
    return INCHES[unit] if unit in INCHES else quantity(f"1 {unit}", "length")
