"""Bundles that are a smooth map of two parameters: trace a few rays and interpolate the others within the tolerance."""
