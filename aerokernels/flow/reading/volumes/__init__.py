"""Volumes: from the solid cells of any mesh to densities at the nodes of a uniform grid."""
