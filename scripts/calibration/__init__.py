"""Calibration of the errors that the package tells, on random scenes whose true errors are known."""
