"""Two-dimensional flows: from polygons in a plane to the cells of a `QuadMesh`, and the body among them."""
