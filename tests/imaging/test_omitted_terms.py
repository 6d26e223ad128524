"""Is a displacement's error covered where coarser grids agree with the field by chance?

Set-up: two weak Gaussian blobs of two to three cells on the axis of an axisymmetric field, a camera 0.5 m before them
and a scene 0.5 m behind; the aperture's middle only, rays in float64.

Expected: the closed form through the same rays, from a field of four times the nodes, whose own error is 4^-3 of the
field's. Every second node gives displacements that differ from the field's by less than the field's own error, and the
order between the second and the fourth node is 4 and more: Richardson's estimate is up to 26 times too small.
"""

import numpy as np
import pytest

from aerokernels import Camera, Disc, IndexField, background_displacement

SIDE = 0.04
# Nodes along z; widths [cells], places [share of the side] and contrasts of the blobs.
CASES = (
    (22, (2.79, 1.95), (0.076, -0.035), (6e-6, -8e-6)),
    (28, (1.9, 2.4), (-0.1, 0.05), (2e-5, -1.5e-5)),
    (24, (2.1, 2.1), (0.02, 0.09), (1e-5, 1e-5)),
)


def field(case, finer: int) -> IndexField:
    count, widths, places, contrasts = case
    nodes = finer * (count - 1) + 1
    r, z = np.linspace(0.0, 0.5 * SIDE, nodes // 2 + 1), np.linspace(-0.5 * SIDE, 0.5 * SIDE, nodes)
    distance, along = np.meshgrid(r, z, indexing="ij")
    samples = np.zeros(distance.shape)
    for width, place, contrast in zip(widths, places, contrasts, strict=True):
        square = distance**2 + (along - place * SIDE) ** 2
        samples += contrast * np.exp(-square / (width * SIDE / (count - 1)) ** 2)
    return IndexField.from_samples(samples, origin=(0.0, z[0]), spacing=(r[1], z[1] - z[0]), geometry="axisymmetric")


@pytest.mark.parametrize("distance", [1.0, np.inf])
@pytest.mark.parametrize("case", CASES)
def test_an_error_that_coarser_grids_do_not_show_is_covered(case, distance):
    camera = Camera(Disc(1e-4, (0.0, 0.0, -0.5)), 50e-3, 2e-5, pixel_count=24, distance=distance)
    options = {"aperture_rays": 1, "allow_truncation": True, "precision": "float64", "tolerance": 1e-5}
    found, right = (background_displacement(field(case, finer), camera, **options) for finer in (1, 4))
    missed = np.linalg.norm(found.displacement - right.displacement, axis=-1)
    assert (missed <= found.error).all() and found.error.max() < 20.0 * missed.max()
