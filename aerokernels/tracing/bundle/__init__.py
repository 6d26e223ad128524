"""Rays as a map of two parameters: few are traced, the others are interpolated within the tolerance."""
