"""
Zernike polynomials of a wavefront
==================================

The flow at Mach 3 at sea level, along a line of sight that is tilted from the axis. The shock causes mostly tilt and
focus; astigmatism and coma follow. Coefficients are rms contributions in nanometres, in Noll's order.
"""

import matplotlib.pyplot as plt
import numpy as np

from aerokernels import Disc, flow, wavefront

air = flow.shipped("mach3").scaled(1.225)
field = air.index_field(wavelength=905e-9).resample(1e-4)
pupil = Disc(radius=5e-3, center=(0, 0, -8e-3))
angle = np.radians(4.0)
seen = wavefront(field, pupil, direction=(0.0, np.sin(angle), np.cos(angle)), pixel_count=48)
coefficients = seen.zernike(15)

figure, panels = plt.subplots(1, 2, figsize=(8.4, 3.4), layout="constrained", width_ratios=(1, 1.5))
picture = panels[0].imshow(seen.remove("piston", "tilt").opd * 1e9, origin="lower")
panels[0].set(title="OPD less piston and tilt", xticks=[], yticks=[])
figure.colorbar(picture, ax=panels[0], label="nm")
panels[1].bar(np.arange(2, 16), np.asarray(coefficients)[1:15] * 1e9)
panels[1].set(xlabel="Noll index", ylabel="coefficient [nm]")
plt.show()
