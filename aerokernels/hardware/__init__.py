"""Echoes from hardware: serial frames and oscilloscope curves, the port, the recorder, its store, simulated boards."""
