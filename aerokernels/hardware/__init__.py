"""Echoes from real hardware: serial frames, the port, the recorder, its store, and a simulated board."""
