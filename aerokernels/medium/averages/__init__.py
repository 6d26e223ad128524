"""From averages over cells to an interpolant that keeps them, on grids and on meshes."""
