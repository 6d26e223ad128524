"""Names of coordinates in files and arrays."""

# In lower case, without blanks, punctuation and units.
COLUMNS = {
    "x": ("x", "points0", "coordinatex", "centersx", "ccx", "xcoordinate", "posx", "positionx"),
    "y": ("y", "points1", "coordinatey", "centersy", "ccy", "ycoordinate", "posy", "positiony"),
    "z": ("z", "points2", "coordinatez", "centersz", "ccz", "zcoordinate", "posz", "positionz"),
    "r": ("r", "radius"),
}
