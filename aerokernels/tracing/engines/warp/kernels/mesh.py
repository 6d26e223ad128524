"""Device functions: the optical potential on a quadrilateral mesh.

The cell that contains a point is found by walking over edges from the cell that contained the ray at the start of its
step; if the walk fails, through the uniform bins.
"""

from types import SimpleNamespace

import warp as wp

from ....scheme import WALK_LIMIT
from ..library import Scene, built_once


@built_once("geometry", "interpolation")
def build_mesh(scene: Scene):
    """Build the functions of a mesh's interpolant."""
    geometry, interpolation = scene.geometry, scene.interpolation
    t = scene.types
    vec2, vec3, real, vec4, Field = t.vec2, t.vec3, t.real, t.vec4, t.Field

    @wp.func
    def furthest_edge(field: Field, cell: int, p: vec2):
        """-1 if the cell contains the point, edges included, else the number of the edge that it is furthest behind."""
        edge_number = int(-1)
        furthest = -field.edge_tolerance
        for k in range(4):
            start = field.corners[4 * cell + k]
            edge = field.corners[4 * cell + (k + 1) % 4] - start
            toward = p - start
            left = edge[0] * toward[1] - edge[1] * toward[0]
            length = wp.length(edge)
            if left < furthest * length:
                furthest = left / length
                edge_number = k
        return edge_number

    @wp.func
    def locate(field: Field, p: vec2, current_cell: int):
        """Index of the cell that contains a point, -1 if none does.

        The walk starts at `current_cell`, a cell nearby, or -1 for no walk. It crosses the edge that the point is
        furthest behind.
        """
        found = int(-1)
        cell = int(current_cell)
        trial = int(0)
        while cell >= 0 and found < 0 and trial < wp.static(WALK_LIMIT):
            edge_number = furthest_edge(field, cell, p)
            if edge_number < 0:
                found = cell
            else:
                cell = field.neighbors[4 * cell + edge_number]
            trial += 1
        if found < 0:
            place = wp.cw_mul(p - field.bin_origin, field.bin_rate)
            i = wp.clamp(int(wp.floor(place[0])), 0, field.bin_count[0] - 1)
            j = wp.clamp(int(wp.floor(place[1])), 0, field.bin_count[1] - 1)
            key = i * field.bin_count[1] + j
            at = int(field.bin_start[key])
            stop = int(field.bin_start[key + 1])
            while found < 0 and at < stop:
                if furthest_edge(field, field.bin_cell[at], p) < 0:
                    found = field.bin_cell[at]
                at += 1
        return found

    if geometry == "planar":

        @wp.func
        def plane_point(frac: vec3):
            """Point in the plane of the mesh; positions on a mesh are in metres."""
            return vec2(frac[1], frac[2])

    else:

        @wp.func
        def plane_point(frac: vec3):
            return vec2(wp.sqrt(frac[0] * frac[0] + frac[1] * frac[1]), frac[2])

    @wp.func
    def within_box(field: Field, p: vec2):
        """The nearest point in the mesh's box.

        Stages of the last step may be beyond the box, where the field is extrapolated linearly.
        """
        return vec2(
            wp.clamp(p[0], field.mesh_low[0], field.mesh_high[0]), wp.clamp(p[1], field.mesh_low[1], field.mesh_high[1])
        )

    @wp.func
    def find_current_cell(field: Field, frac: vec3, current_cell: int):
        """The cell from which the next lookups of a ray start."""
        return locate(field, within_box(field, plane_point(frac)), current_cell)

    @wp.func
    def blend(field: Field, first: int, w: vec4):
        """Contrast and node gradient, each the sum over the four corners by weights."""
        m = real(0.0)
        g = vec2(real(0.0), real(0.0))
        for k in range(4):
            m += w[k] * field.values[first + k]
            g += w[k] * field.gradients[first + k]
        return vec3(m, g[0], g[1])

    if interpolation == "idw":

        @wp.func
        def in_cell(field: Field, cell: int, p: vec2):
            first = 4 * cell
            size = wp.length(field.corners[first + 2] - field.corners[first])
            d = vec4(
                wp.length(p - field.corners[first]) / size,
                wp.length(p - field.corners[first + 1]) / size,
                wp.length(p - field.corners[first + 2]) / size,
                wp.length(p - field.corners[first + 3]) / size,
            )
            w = vec4(d[1] * d[2] * d[3], d[0] * d[2] * d[3], d[0] * d[1] * d[3], d[0] * d[1] * d[2])
            return blend(field, first, w / (w[0] + w[1] + w[2] + w[3]))

    else:

        @wp.func
        def in_cell(field: Field, cell: int, p: vec2):
            first = 4 * cell
            origin = field.corners[first]
            b = field.corners[first + 1] - origin
            c = field.corners[first + 2] - origin
            d = field.corners[first + 3] - origin
            target = p - origin
            xi = real(0.5)
            eta = real(0.5)
            along = b
            across = d
            det = real(1.0)
            # Newton's method; the last pass only computes the Jacobian at the solution, for the gradient.
            for trial in range(8):
                along = (real(1.0) - eta) * b + eta * (c - d)
                across = (real(1.0) - xi) * d + xi * (c - b)
                det = along[0] * across[1] - along[1] * across[0]
                if trial < 7:
                    miss = xi * (real(1.0) - eta) * b + xi * eta * c + (real(1.0) - xi) * eta * d - target
                    step_xi = (miss[0] * across[1] - miss[1] * across[0]) / det
                    step_eta = (along[0] * miss[1] - along[1] * miss[0]) / det
                    xi = wp.clamp(xi - step_xi, real(-0.5), real(1.5))
                    eta = wp.clamp(eta - step_eta, real(-0.5), real(1.5))
            if wp.static(interpolation == "bilinear-barron"):
                w = vec4((real(1.0) - xi) * (real(1.0) - eta), xi * (real(1.0) - eta), xi * eta, (real(1.0) - xi) * eta)
                return blend(field, first, w)
            else:
                base = field.values[first]
                vb = field.values[first + 1] - base
                vc = field.values[first + 2] - base
                vd = field.values[first + 3] - base
                m = base + xi * (real(1.0) - eta) * vb + xi * eta * vc + (real(1.0) - xi) * eta * vd
                rise = (real(1.0) - eta) * vb + eta * (vc - vd)
                lift = (real(1.0) - xi) * vd + xi * (vc - vb)
                return vec3(m, (rise * across[1] - lift * along[1]) / det, (lift * along[0] - rise * across[0]) / det)

    @wp.func
    def sample_in(field: Field, inside: int, frac: vec3):
        """Potential s and its gradient [1/m] by the interpolant of one cell.

        The contrast m is interpolated, and s = m (a + m / 2), grad s = (a + m) grad m.
        """
        p = plane_point(frac)
        edge = within_box(field, p)
        s = in_cell(field, inside, edge)
        s[0] += s[1] * (p[0] - edge[0]) + s[2] * (p[1] - edge[1])
        index = field.ambient + s[0]
        s = vec3(s[0] * (field.ambient + real(0.5) * s[0]), index * s[1], index * s[2])
        if wp.static(geometry == "planar"):
            return vec4(s[0], real(0.0), s[1], s[2])
        else:
            outward = real(0.0)
            if p[0] > real(0.0):
                outward = s[1] / p[0]
            return vec4(s[0], outward * frac[0], outward * frac[1], s[2])

    @wp.func
    def sample(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int):
        """Potential and its gradient [1/m]; zero outside the mesh."""
        inside = locate(field, within_box(field, plane_point(frac)), current_cell)
        if inside < 0:
            return vec4(real(0.0), real(0.0), real(0.0), real(0.0))
        return sample_in(field, inside, frac)

    @wp.func
    def paper_step(field: Field, cell: wp.vec3i, frac: vec3, current_cell: int):
        """Step length of eq 5 in the cell of the point [m].

        Outside the mesh it is the median over all cells, which is stored after the entry of the last cell.
        """
        inside = locate(field, plane_point(frac), current_cell)
        if inside < 0:
            return field.paper_step[field.cell_count]
        return field.paper_step[inside]

    return SimpleNamespace(**locals())
