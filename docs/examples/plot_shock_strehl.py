"""
Maréchal's approximation fails at a shock
=========================================

A shock that crosses a pupil delays one part of the light by a step. The exact Strehl ratio of a step returns to 1 after
a whole wave. Maréchal's approximation depends on the rms alone and keeps falling.
"""

import matplotlib.pyplot as plt
import numpy as np

from aerokernels import strehl, strehl_marechal

wavelength = 905e-9
pupil = np.linspace(-1.0, 1.0, 2001)
steps = np.linspace(0.0, 1.5, 61)  # height of the step [waves]
exact, approximate = [], []
for step in steps:
    opd = step * wavelength * (pupil > 0.3)
    exact.append(strehl(opd, wavelength))
    approximate.append(strehl_marechal(opd, wavelength))

figure, panel = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
panel.plot(steps, exact, label="exact")
panel.plot(steps, approximate, "--", label="Maréchal")
panel.set(xlabel="step of the optical path difference [waves]", ylabel="Strehl ratio")
panel.legend()
plt.show()
