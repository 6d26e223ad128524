"""The reference engine, the oracle of the kernels, in float64 NumPy and SciPy."""
