"""Soak tests of recording on a pseudo-terminal: faults, kills, unplugged ports, load; see scripts/hardware_soak."""
