"""The Warp kernel that interpolates rays of a two-parameter family between traced rays.

It uses the table of bundle/table.py, one lookup per ray. tests/tracing/bundle/bundle_delivery.py has the same formulas
in NumPy.
"""

import warp as wp

from ....bundle.table import FAR
from ....result import output_mask
from ....status import NOT_DELIVERED, RayStatus
from ..library import KernelLibrary, built_once
from .bundle_family import family_parameters, undisturbed_length
from .outputs import build_write_outputs
from .patches import build_in_patch

# The outputs that a block's header has for all its rays.
# Per thread of a GPU; more, as the compiler would take, or fewer make the kernel slower.
MOST_REGISTERS = 128
COSTS = output_mask(frozenset(("step_error", "step_count", "evaluation_count")))


@built_once
def build_bundle_kernel(library: KernelLibrary, channel_count: int):
    """Build the kernel for patches with `channel_count` channels: 1, 4 or 8 (bundle/nodes.py)."""
    real = library.types.real
    in_patch = build_in_patch(library, channel_count)
    Arrival = library.types.Arrival
    write_outputs = build_write_outputs(library)
    ok = int(RayStatus.OK)

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=MOST_REGISTERS)
    def deliver_bundle(
        block_map: wp.array(dtype=wp.int32),
        header: wp.array(dtype=wp.float64),
        patches: wp.array(dtype=real),
        frame: wp.array(dtype=wp.float64),
        map_u: int,
        map_v: int,
        converges: int,
        stop: int,
        shape: int,
        checks_faces: int,
        faces_that_matter: int,
        requested: int,
        first_ray: int,
        position_in: wp.array(dtype=wp.vec3d),
        direction_in: wp.array(dtype=wp.vec3d),
        outputs: library.types.RayOutputs,
    ):
        ray = wp.tid() + first_ray
        p = position_in[ray]
        d = direction_in[ray]
        zero = wp.float64(0.0)
        parameters = family_parameters(frame, converges, p, d)
        place_u = (parameters[0] - frame[0]) * frame[2]
        place_v = (parameters[1] - frame[1]) * frame[3]
        good = parameters[2] > zero and place_u >= zero and place_v >= zero
        good = good and place_u < wp.float64(map_u) and place_v < wp.float64(map_v)
        block = int(-1)
        if good:
            block = block_map[int(place_u) * map_v + int(place_v)]
        length = zero
        if block >= 0:
            line = undisturbed_length(frame, stop, shape, checks_faces, faces_that_matter, p, d)
            length = line[0]
            good = length > zero and length < wp.float64(wp.static(FAR))
            good = good and (checks_faces == 0 or line[1] == header[8 * block + 4])
        # A ray without a patch looks one up all the same: threads of a GPU do so together.
        good = good and block >= 0
        head = int(0)
        if good:
            head = 8 * block
        u = (parameters[0] - header[head]) * header[head + 2]
        v = (parameters[1] - header[head + 1]) * header[head + 3]
        i = wp.clamp(int(u), 0, 3)
        j = wp.clamp(int(v), 0, 3)
        at = int(0)
        if good:
            at = 4 * ((block * 5 + i) * 5 + j)
        found = in_patch(patches, at, real(u - wp.float64(i)), real(v - wp.float64(j)))
        if not good:
            outputs.status[ray] = wp.static(NOT_DELIVERED)
            return

        arrival = Arrival()
        arrival.opd = wp.float64(found[0])
        if wp.static(channel_count > 1):
            turned = d + wp.vec3d(wp.float64(found[1]), wp.float64(found[2]), wp.float64(found[3]))
            arrival.direction = turned / wp.sqrt(wp.dot(turned, turned))
        if wp.static(channel_count > 4):
            moved = wp.vec3d(wp.float64(found[4]), wp.float64(found[5]), wp.float64(found[6]))
            arrival.position = p + length * d + moved
            arrival.arc_length = length + wp.float64(found[7])
        arrival.optical_path = frame[39] * length + arrival.opd
        arrival.status = int(ok)
        step_error = zero
        step_count = int(0)
        evaluation_count = int(0)
        if (requested & wp.static(COSTS)) != 0:
            step_error = header[head + 5]
            step_count = int(header[head + 6])
            evaluation_count = int(header[head + 7])
        write_outputs(outputs, requested, ray, arrival, step_error, step_count, evaluation_count)

    return deliver_bundle
