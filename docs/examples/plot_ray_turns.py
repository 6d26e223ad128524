"""
Rays in a gradient
==================

Rays that start parallel in a medium n² = n0² (1 − g² y²) are sine waves that meet on the axis periodically. The traced
rays agree with the exact ones. The tests check the tracer with such media.
"""

import matplotlib.pyplot as plt
import numpy as np

from aerokernels import ArcLength, IndexField, RayBundle, trace

n0, g, spacing = 1.5, 100.0, 2.5e-4
y = np.arange(-3e-3, 3e-3 + spacing / 2, spacing)
z = np.arange(0.0, 62e-3 + spacing / 2, spacing)
contrast = n0 * np.sqrt(1 - (g * y) ** 2)[:, None] * np.ones_like(z) - n0
field = IndexField.from_samples(
    contrast, origin=(y[0], z[0]), spacing=(spacing, spacing), geometry="planar", ambient_index=n0
)
heights = np.linspace(-2e-3, 2e-3, 9)
start = np.stack([np.zeros(9), heights, np.full(9, 1e-6)], axis=1)
rays = RayBundle(start, np.tile([0.0, 0.0, 1.0], (9, 1)))

figure, panel = plt.subplots(figsize=(7.4, 3.2), layout="constrained")
stops = np.linspace(1e-3, 60e-3, 60)
places = np.array(
    [trace(field, rays, until=ArcLength(stop), precision="float64", bundle="off").position for stop in stops]
)
for ray, height in enumerate(heights):
    panel.plot(1e3 * places[:, ray, 2], 1e3 * places[:, ray, 1], color="C0", linewidth=1)
    beta = n0 * np.sqrt(1 - (g * height) ** 2)
    panel.plot(1e3 * z, 1e3 * height * np.cos(n0 * g * z / beta), "k:", linewidth=0.8)
panel.set(xlabel="z [mm]", ylabel="y [mm]", title="traced (lines) and exact (dots)")
plt.show()
