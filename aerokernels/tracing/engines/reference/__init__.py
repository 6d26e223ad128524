"""The oracle in float64 NumPy and SciPy."""
