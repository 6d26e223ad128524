"""Benchmarks: measure speed together with the error on any device, and write JSON and a table.

suite     what is measured
cone      a million rays along z through the cone's volume: `trace(..., outputs=("direction", "optical_path"))`
strehl    the Strehl ratio of the shipped Mach 3 field, from launch to value
"""
