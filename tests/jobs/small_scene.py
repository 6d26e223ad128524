"""A scene that ships, small enough for tests that run it whole."""

SMALL_SCENE = """
flow.source = "mach3"
flow.relation = "gladstone-dale"
grid.spacing = 4e-4
strehl.ray_count = 160
beam.ray_count = 25
receiver.ray_count = 64
trace.backend = "warp"
trace.device = "cpu"
"""
