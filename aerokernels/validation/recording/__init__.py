"""Recording put to the test on a pseudo-terminal: faults, kills, unplugged ports, load; see scripts/hardware_soak."""
