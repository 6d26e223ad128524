"""The index field in three dimensions: geometries, boxes, gradients, recognition of averages, refusals."""

import numpy as np
import pytest

from aerokernels import Body, IndexField, QuadMesh

SHAPES = {"volume": (6, 5, 7), "planar": (6, 7), "axisymmetric": (6, 7)}


def noise_field(geometry: str, interpolation: str, seed: int = 0) -> IndexField:
    shape = SHAPES[geometry]
    origin = {"volume": (-0.5, 0.2, 1.0), "planar": (-0.5, 1.0), "axisymmetric": (0.0, 1.0)}[geometry]
    samples = np.random.default_rng(seed).uniform(-0.1, 0.1, shape)
    return IndexField.from_samples(samples, origin=origin, spacing=[0.25, 0.3, 0.2][: len(shape)], geometry=geometry,
                                   ambient_index=1.3, interpolation=interpolation)  # fmt: skip


def mesh_field(geometry: str, interpolation: str = "bilinear", seed: int = 0) -> IndexField:
    first, second = np.meshgrid(np.linspace(0.0, 1.0, 6), np.linspace(0.0, 2.0, 7), indexing="ij")
    mesh = QuadMesh.structured(first + 0.1 * first * np.sin(second), second + 0.1 * first, geometry)
    values = np.random.default_rng(seed).uniform(-0.1, 0.1, (6, 7))
    return IndexField.from_mesh(mesh, values, ambient_index=1.3, interpolation=interpolation)


def scattered(field: IndexField, count: int, seed: int = 1) -> np.ndarray:
    low, high = (np.where(np.isfinite(c), c, s) for c, s in zip(field.box, (-3.0, 3.0), strict=True))
    return np.random.default_rng(seed).uniform(low, high, (count, 3))


@pytest.mark.parametrize(
    ("geometry", "interpolation"),
    [
        *((g, i) for g in SHAPES for i in ("cubic", "monotone", "linear")),
        ("planar", "bilinear"),
        ("axisymmetric", "bilinear"),
    ],
)
def test_gradient_is_the_derivative_of_the_contrast_in_space(geometry, interpolation):
    """Noise as data, all three components; central differences of step d = 1e-6 m.

    Truncation d^2 max|m'''| / 6 < 1e-10, rounding 1e-16 / d = 1e-10. A step that crosses a cell's edge sees the kink
    of a C0 interpolant: those (a share of 1e-5) and the few on the box's faces are left out. Tolerance 1e-7.
    """
    field = mesh_field(geometry) if interpolation == "bilinear" else noise_field(geometry, interpolation)
    points = scattered(field, 400)
    points = points[field.contrast_at(points) != 0.0]
    gradient = field.gradient_at(points)
    difference = np.empty_like(gradient)
    for axis in range(3):
        step = 1e-6 * np.eye(3)[axis]
        difference[:, axis] = (field.contrast_at(points + step) - field.contrast_at(points - step)) / 2e-6
    good = np.abs(difference - gradient).max(axis=1) < 1e-7
    assert len(points) > 150 and good.mean() > 0.99


@pytest.mark.parametrize("geometry", SHAPES)
def test_box_and_outside(geometry):
    """The index outside the box is ambient: contrast and gradient are nil there; faces belong to the box."""
    field = noise_field(geometry, "cubic")
    low, high = field.box
    expected = {
        "volume": ([-0.5, 0.2, 1.0], [0.75, 1.4, 2.2]),
        "planar": ([-np.inf, -0.5, 1.0], [np.inf, 0.75, 2.8]),
        "axisymmetric": ([-1.25, -1.25, 1.0], [1.25, 1.25, 2.8]),
    }[geometry]
    assert low == pytest.approx(expected[0]) and high == pytest.approx(expected[1])
    for axis in range(3):
        for face, out in ((low, -1e-6), (high, 1e-6)):
            if not np.isfinite(face[axis]):
                continue
            point = 0.5 * (np.where(np.isfinite(low), low, -1.0) + np.where(np.isfinite(high), high, 1.0))
            point[axis] = face[axis]
            if geometry == "axisymmetric" and axis < 2:
                point[1 - axis] = 0.0
            assert field.contrast_at(point)[0] != 0.0
            point[axis] += out
            assert field.contrast_at(point)[0] == 0.0 and (field.gradient_at(point) == 0.0).all()


def test_vertex_values_and_cell_averages_are_told_apart_by_shape():
    """A linear contrast on a uniform mesh: both ways of giving it make the same field away from rounding."""
    first, second = np.meshgrid(np.linspace(0.0, 1.0, 6), np.linspace(0.0, 2.0, 7), indexing="ij")
    mesh = QuadMesh.structured(first, second, "planar")
    nodal, average = 1e-3 * (mesh.vertices @ [1.0, 2.0]), 1e-3 * (mesh.cell_centroid @ [1.0, 2.0])
    fields = [
        IndexField.from_mesh(mesh, c)
        for c in (nodal, nodal.reshape(6, 7), average, average.reshape(5, 6), list(average.reshape(5, 6)))
    ]
    points = np.random.default_rng(0).uniform([0, 0, 0], [1, 1, 2], (200, 3))
    for field in fields:
        assert np.abs(field.contrast_at(points) - 1e-3 * points[:, 1:] @ [1.0, 2.0]).max() < 1e-16
        assert field.mesh is mesh and not field.is_uniform and field.interpolation == "bilinear"


GOOD = {"contrast": np.zeros((4, 5)), "origin": (0.0, 0.0), "spacing": (1.0, 1.0), "geometry": "planar"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"geometry": "spherical"}, "'spherical' is not known: choose one of volume, planar, axisymmetric"),
        ({"geometry": "volume"}, r"volume field needs an array of 3 axes, got shape \(4, 5\)"),
        ({"contrast": np.zeros(4)}, r"planar field needs an array of 2 axes, got shape \(4,\)"),
        ({"contrast": np.array([[0.0, np.nan], [np.nan, 0.0]])}, r"2 of 4 samples of the contrast.*\(0, 1\)"),
        ({"contrast": np.eye(4, 5) - 1.0}, "index must be positive everywhere: the least contrast is -1"),
        ({"contrast": np.full((4, 5), -1.0)}, "index must be positive everywhere: the least contrast is -1"),
        ({"geometry": "axisymmetric", "origin": (0.5, 0.0)}, "starts at r = 0, got origin .*0.5"),
        ({"ambient_index": 0.0}, "ambient_index must be positive and finite, got 0.0"),
        ({"ambient_index": np.nan}, "ambient_index must be positive and finite, got nan"),
        ({"spacing": (1.0, 0.0)}, "spacing must be positive"),
        ({"spacing": (1.0,)}, r"one entry per array axis \(2\)"),
        ({"interpolation": "bilinear"}, "'bilinear' is not known: choose one of cubic, linear, monotone"),
        ({"body": Body([[0, 0], [1, 0], [1, 1]], "axisymmetric")}, "the body is axisymmetric, the field planar"),
        (
            {
                "body": Body([[0, 0], [1, 0], [1, 1]], "planar"),
                "geometry": "volume",
                "contrast": np.zeros((3, 3, 3)),
                "origin": (0.0, 0.0, 0.0),
                "spacing": (1.0, 1.0, 1.0),
            },
            "the body is planar, the field volume",
        ),
    ],
)
def test_what_from_samples_refuses(change, message):
    with pytest.raises(ValueError, match=message):
        IndexField.from_samples(**{**GOOD, **change})


@pytest.mark.parametrize("contrast", [np.array([["a", "b"], ["c", "d"]]), np.zeros((3, 3), dtype=complex)])
def test_only_real_numbers(contrast):
    with pytest.raises(TypeError, match="array of real numbers, got dtype"):
        IndexField.from_samples(contrast, origin=(0, 0), spacing=(1, 1), geometry="planar")


@pytest.mark.parametrize(
    ("contrast", "options", "message"),
    [
        (np.zeros(11), {}, r"shape \(11,\).*vertex, shape \(12,\) or \(3, 4\).*cell, shape \(6,\) or \(2, 3\)"),
        # The right number of entries in another order is another field.
        (np.zeros((4, 3)), {}, r"shape \(4, 3\)"),
        (np.zeros((3, 2)), {}, r"shape \(3, 2\)"),
        (np.array([0.0] * 4 + [np.inf, np.nan]), {}, r"2 of 6 samples of the contrast.*\(4,\)"),
        (np.zeros(12), {"interpolation": "cubic"}, "'cubic' is not known on a mesh"),
        (np.zeros(12), {"ambient_index": -1.0}, "ambient_index must be positive"),
        (np.full(12, -2.0), {}, "index must be positive everywhere"),
        (np.zeros(12), {"body": Body([[0, 0], [1, 0], [1, 1]])}, "the body is axisymmetric, the field planar"),
    ],
)
def test_what_from_mesh_refuses(contrast, options, message):
    mesh = QuadMesh.structured(*np.meshgrid(np.arange(3.0), np.arange(4.0), indexing="ij"))
    with pytest.raises(ValueError, match=message):
        IndexField.from_mesh(mesh, contrast, **options)


@pytest.mark.parametrize(
    ("spacing", "origin", "message"),
    [
        (1e9, 0.0, r"box is 4e\+09 by 4e\+09 m, outside the range of flows.*give lengths in metres"),
        (3e6, 0.0, r"box is 1\.2e\+07 by"),
        (1e-10, 0.0, r"box is 4e-10 by"),
        (1e-300, 0.0, r"box is 4e-300 by"),
        (1e-6, 1e6, r"spacing of .* m is not resolved at coordinates of .*Give metres"),
    ],
)
def test_a_box_that_is_no_flows_is_refused(spacing, origin, message):
    """Lengths in another unit: sides beyond 1e7 m or below 1e-9 m, nodes that float64 does not tell apart."""
    with pytest.raises(ValueError, match=message):
        IndexField.from_samples(
            np.zeros((5, 5)), origin=(origin, 0.0), spacing=(spacing, spacing), geometry="planar", ambient_index=1.0
        )


def test_what_is_not_a_number_stays_none():
    """A point that is NaN has no contrast; the coordinate along which a field does not change may be anything."""
    field = IndexField.from_samples(np.full((5, 5), 1e-4), origin=(0, 0), spacing=(0.1, 0.1), geometry="planar")
    contrast, gradient = field.evaluate([[0.0, np.nan, 0.1], [np.nan, 0.1, 0.1], [0.0, np.inf, 0.1]])
    assert np.isnan(contrast[0]) and contrast[1] == pytest.approx(1e-4) and contrast[2] == 0.0
    assert np.isnan(gradient[0]).all() and np.isfinite(gradient[1:]).all()


def test_indices_in_place_of_contrasts_are_noticed_on_meshes_too():
    mesh = QuadMesh.structured(*np.meshgrid(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 6), indexing="ij"))
    for shape in ((5, 6), (20,)):
        with pytest.warns(UserWarning, match="it is n - ambient_index, not n itself"):
            IndexField.from_mesh(mesh, np.full(shape, 1.0003))


def test_rounding_puts_no_point_outside():
    """Beyond a face by half of 1e-12 of the side the field is there, by three times that it is not."""
    field = IndexField.from_samples(np.full((5, 5), 1e-4), origin=(-7.0, 3.0), spacing=(0.5, 0.25), geometry="planar")
    low, high = np.array([-7.0, 3.0]), np.array([-5.0, 4.0])
    for axis, (face, out) in ((0, (low, -1.0)), (0, (high, 1.0)), (1, (low, -1.0)), (1, (high, 1.0))):
        side = high[axis] - low[axis]
        for share, inside in ((0.4e-12, True), (3e-12, False)):
            point = np.array([0.0, -6.0, 3.5])
            point[1 + axis] = face[axis] + out * share * side
            assert (field.contrast_at(point[None])[0] != 0.0) == inside
