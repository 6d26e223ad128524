"""
Range walk of a fixed threshold
===============================

A lower echo crosses a fixed threshold later, so the measured range grows with the loss. The curve can be computed
from the pulse, and taken off the reading. A constant fraction of the peak does not walk.
"""

import matplotlib.pyplot as plt
import numpy as np

from aerokernels import estimate_range, plane_target_echo

time = np.arange(0.0, 40e-9, 25e-12)
echo = plane_target_echo(
    time, peak_power=75.0, receiver_diameter=12e-3, beam_radius=30e-3, distance=1.5, pulse_tau=6e-9, reflectivity=0.3
)
shares = np.linspace(0.55, 1.0, 46)
edge = [estimate_range(time, share * echo, "leading-edge", threshold=0.5 * echo.max()) for share in shares]
fraction = [estimate_range(time, share * echo, "constant-fraction") for share in shares]

figure, panel = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
panel.plot(shares, 1e3 * (np.array(edge) - edge[-1]), label="leading edge at half of the full peak")
panel.plot(shares, 1e3 * (np.array(fraction) - fraction[-1]), "--", label="constant fraction")
panel.set(xlabel="Strehl ratio (peak over peak without flow)", ylabel="change of the measured range [mm]")
panel.legend()
plt.show()
