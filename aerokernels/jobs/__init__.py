"""Whole jobs: one run from scene to range, its stored result, its pictures and its report."""
