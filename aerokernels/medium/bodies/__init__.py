"""Solid bodies in the flow: their surfaces, points inside them, and where lines cross them."""
