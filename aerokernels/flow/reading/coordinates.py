"""Names of coordinates, as files and arrays call them."""

# In lower case and without blanks, signs and units.
COLUMNS = {
    "x": ("x", "points0", "coordinatex", "centersx", "ccx", "xcoordinate", "posx", "positionx"),
    "y": ("y", "points1", "coordinatey", "centersy", "ccy", "ycoordinate", "posy", "positiony"),
    "z": ("z", "points2", "coordinatez", "centersz", "ccz", "zcoordinate", "posz", "positionz"),
    "r": ("r", "radius"),
}
