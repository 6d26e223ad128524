// Both ends of nearly straight rays in double: the functions of generated/ends.h for all lanes of a packet.
#ifndef PACKET_ENDS_H
#define PACKET_ENDS_H

#include "generated/wall.h"
#include "packet_box.h"
#include "ray_status.h"
#include "support.h"

// Change k of the momentum along the normal of the body where rays leave it, see starting_momentum in wall.h; `before` is the
// momentum along it. A ray that would be reflected within the body runs along its surface.
#define LEAVING_KICK(before, potential)                                                                                \
    max(R(2.0) * (potential) / ((before) + sqrt(max((before) * (before) + R(2.0) * (potential), R(0.0)))), -(before))

// Initial statuses of rays, and the intervals of the undisturbed rays.
typedef struct {
    Spans whole;           // ends of their paths in the box, with the part in uniform air
    Spans part;            // the part of the path in which the air is not uniform
    doubles stop_distance;
    truths has_stop;       // whether they ever reach the stop
    truths meets;          // whether they meet the box before the stop
    truths runs;           // whether they do so with status OK
    truths uniform;        // whether they end in uniform air
    truths surface;        // if not, the surface on which they end, else -1
    truths status;
    Triples normal;        // outward, where they leave the body in which they start; zero for other rays
} Starts;

#if HAS_BODY
// A ray that starts inside the body begins where it leaves the body. If the body extends beyond the box, a ray may hit
// the body before it reaches the box.
static inline void start_at_walls(
    const Field *field, const Arrays *arrays, Triples p, Triples d, Spans span, Starts *starts, doubles *enter)
{
    for (int lane = 0; lane < LANES; lane++) {
        if (!TRUTH_AT(starts->meets, lane)) {
            continue;
        }
        const double3 place = TRIPLE_AT(p, lane), direction = TRIPLE_AT(d, lane);
        const double first = DOUBLE_AT(*enter, lane), stop_distance = DOUBLE_AT(starts->stop_distance, lane);
        const WallMeeting met = body_exit(field, arrays, place, direction, first);
        const double leaves = met.exit;
        const double hits = body_entry(field, arrays, place, direction, first);
        if (hits < NEVER) {
            NUMBER_AT(starts->status, lane) = RAY_HIT_BODY;
            DOUBLE_AT(*enter, lane) = hits;
        } else if (
            STOP != NONE && TRUTH_AT(starts->has_stop, lane) &&
            stop_distance <= lesser64(leaves, DOUBLE_AT(span.leave, lane))) {
            NUMBER_AT(starts->meets, lane) = 0;
        } else if (
            (leaves > first && leaves >= (1.0 - ENTRY_ROUNDING) * DOUBLE_AT(span.leave, lane)) || leaves >= NEVER) {
            NUMBER_AT(starts->status, lane) = RAY_INSIDE_BODY;  // it comes out where the box ends, if at all
        } else {
            DOUBLE_AT(*enter, lane) = leaves;
            if (met.odd) {
                const double3 normal = outward_normal(field, arrays, met.piece, place + leaves * direction);
                DOUBLE_AT(starts->normal.x, lane) = normal.x;
                DOUBLE_AT(starts->normal.y, lane) = normal.y;
                DOUBLE_AT(starts->normal.z, lane) = normal.z;
            }
        }
    }
}
#endif

static inline Starts start_each(const Field *field, const Arrays *arrays, const Bounds *bounds, Triples p, Triples d)
{
    Starts starts;
    starts.status = (truths)RAY_OK;
    starts.normal = in_all_lanes((double3)0.0);
    starts.has_stop = (truths)0 == (truths)0;

    // Where the undisturbed rays stop, and whether they meet the box before.
    const Spans span = crossing_each(VECTOR64(bounds->low), VECTOR64(bounds->high), bounds->radius, p, d);
    doubles enter = greater_each(span.enter, (doubles)0.0);
    starts.meets = (span.enter <= span.leave) & (span.leave >= 0.0);
    starts.stop_distance = span.leave;
#if STOP == PLANE
    Triples normal;
    const doubles height = surface_each(bounds, FACE_COUNT, p, &normal), slope = inner(normal, d);
    starts.has_stop = (height == 0.0) | ((height * slope < 0.0) & (fabs(slope) > LEAST_SLOPE));
    starts.stop_distance = CHOOSE64((doubles)0.0, -height / slope, (height != 0.0) & starts.has_stop);
#elif STOP == ARC
    starts.stop_distance = (doubles)bounds->length;
#else
    if (GEOMETRY == PLANAR) {  // along x, where it has no end
        starts.status =
            CHOOSE64(starts.status, (truths)RAY_STOP_NOT_REACHED, starts.meets & (span.leave > 1.0e299));
    }
#endif
    if (STOP != NONE) {
        starts.meets &= !starts.has_stop | (starts.stop_distance > enter);
    }
#if HAS_BODY
    start_at_walls(field, arrays, p, d, span, &starts, &enter);
#endif
    starts.whole.enter = enter;
    starts.whole.leave = span.leave;
    if (STOP != NONE) {
        starts.whole.leave =
            CHOOSE64(span.leave, lesser_each(span.leave, starts.stop_distance), starts.has_stop);
    }
    starts.runs = starts.meets & (starts.status == (truths)RAY_OK);
    starts.part = starts.whole;
    starts.uniform = starts.runs & keep_support(bounds, p, d, &starts.part.enter, &starts.part.leave);
    starts.part.enter = CHOOSE64(starts.whole.enter, starts.part.enter, starts.runs);
    starts.part.leave = CHOOSE64(starts.whole.leave, starts.part.leave, starts.runs);

    // Number of the surface on which the undisturbed ray ends.
    const truths disturbed = starts.runs & !starts.uniform;
    truths surface = (truths)FACE_COUNT;
    truths elsewhere = disturbed;
    if (STOP == PLANE) {
        elsewhere &= !starts.has_stop | (starts.whole.leave != starts.stop_distance);
    }
    if (SOME(elsewhere)) {
        const truths face = nearest_face_each(bounds, ahead_of(p, starts.whole.leave, d));
        surface = CHOOSE64(surface, face, elsewhere);
    }
    starts.surface = CHOOSE64((truths)(-1), surface, disturbed);
    return starts;
}

// The rays at their stop.
typedef struct {
    Triples position, heading;
    doubles optical_path, opd, arc_length;
    doubles flight;         // beyond the box
    truths status;
} Arrivals;

// Change of the unit tangents from d when the momentum is ambient d + p, without cancellation.
static inline Triples deflection_each(double ambient, Triples d, Triples p)
{
    const doubles x = ambient * d.x + p.x, y = ambient * d.y + p.y, z = ambient * d.z + p.z;
    const doubles speed = sqrt(x * x + y * y + z * z);
    const doubles excess = (2.0 * ambient * inner(d, p) + inner(p, p)) / (speed + ambient);
    return triples_of((p.x - excess * d.x) / speed, (p.y - excess * d.y) / speed, (p.z - excess * d.z) / speed);
}

// Distance at which a line meets surface k. For a line that grazes the surface it returns the guess `along`.
static inline doubles meeting_each(const Bounds *bounds, int k, Triples p, Triples d, doubles along)
{
    const int trials = GEOMETRY == AXISYMMETRIC && k == 2 ? 3 : 1;  // Newton's method; on flat faces one step is exact
    for (int trial = 0; trial < trials; trial++) {
        Triples normal;
        const doubles miss = surface_each(bounds, k, ahead_of(p, along, d), &normal);
        const doubles cosine = along_normal(k, normal, d);
        along -= CHOOSE64((doubles)0.0, miss / cosine, fabs(cosine) > LEAST_COSINE);
    }
    return along;
}

// Correction for a ray that grazes surface k: the remaining length along the tangent `heading` to the surface [m]; see
// `grazing_correction` in box.h.
static inline doubles grazing_correction_each(
    const Bounds *bounds, const Control *control, int k, Triples p, Triples d, Triples heading)
{
    Triples normal;
    const doubles miss = surface_each(bounds, k, p, &normal);
    const doubles cosine = along_normal(k, normal, heading);
    const double most = GRAZING_TOLERANCE / (double)greatest(VECTOR(control->cell_rate));
    const truths grazes = (fabs(along_normal(k, normal, d)) <= LEAST_COSINE) & (fabs(miss) < most * fabs(cosine));
    return CHOOSE64((doubles)0.0, -miss / cosine, grazes);
}

// Extra distance along d to face k for a line shifted by q, relative to the line itself, which leaves the box at
// `leave`. Returns `other` if the line leaves by another face or at a grazing angle.
static inline doubles detour_each(
    const Bounds *bounds, int k, Triples p, Triples d, Triples q, doubles leave, doubles other)
{
    Triples normal;
    const doubles miss = surface_each(bounds, k, ahead_of(p, leave, d), &normal);
    const doubles cosine = along_normal(k, normal, d);
    const doubles size = size64(VECTOR64(bounds->high) - VECTOR64(bounds->low)) + sqrt(inner(p, p));
    truths keeps = (fabs(miss) > 1.0e-14 * size) | (fabs(cosine) < LEAST_COSINE);
    doubles further = -along_normal(k, normal, q) / cosine;
    if (GEOMETRY == AXISYMMETRIC && k == 2) {
        // |c + (further d + q)|^2 = |c|^2 across the axis, c of length `radius`: the root that is 0 for q = 0
        const doubles x = p.x + leave * d.x, y = p.y + leave * d.y;
        const doubles a = d.x * d.x + d.y * d.y, b = (x + q.x) * d.x + (y + q.y) * d.y;
        const doubles c = (2.0 * x + q.x) * q.x + (2.0 * y + q.y) * q.y;
        const doubles square = b * b - a * c;
        keeps |= (b <= 0.0) | (square < 0.0);
        further = -c / (b + sqrt(square));
    }
    return CHOOSE64(further, other, keeps);
}

// The rays at their stop: adds the sums of the samples, (sigma, S, M, B), to the straight rays and flies on to a stop
// outside the box. `ends_on` is the number of the surface on which each ray ended, or -1.
static inline Arrivals end_each(
    const Bounds *bounds,
    const Control *control,
    Triples p,
    Triples d,
    const Starts *starts,
    truths ends_on,
    Triples q,
    Triples momentum,
    doubles sigma,
    doubles path,
    doubles arc,
    doubles lagging)
{
    const double ambient = bounds->ambient;
    const doubles work = 2.0 * path;
    const truths meets = starts->meets;
    // Along d the deviation is int (T . d - a) d sigma = M - B: sums of the same values as the path (motion.py).
    q = ahead_of(q, arc - lagging - inner(q, d), d);
    const Triples tangent_change = deflection_each(ambient, d, momentum);
    const Triples heading = sum_of(d, tangent_change);
    doubles along = starts->part.enter + ambient * sigma;  // distance along the straight ray
    const Triples place = sum_of(p, q);
#pragma unroll
    for (int k = 0; k <= FACE_COUNT; k++) {
        const truths now = ends_on == (truths)k;
        if ((k < FACE_COUNT || STOP == PLANE) && SOME(now)) {
            const doubles met = meeting_each(bounds, k, place, d, along);
            const doubles rest =
                grazing_correction_each(bounds, control, k, sum_of(ahead_of(p, met, d), q), d, heading);
            along = CHOOSE64(along, met + rest, now);
            q = choose_triples(q, ahead_of(q, rest, tangent_change), now);
        }
    }
    Arrivals out;
    out.status = starts->status;
    doubles stop_distance = starts->stop_distance;
    along = CHOOSE64((doubles)0.0, along, meets);
    if (STOP == NONE) {
        out.status = CHOOSE64((truths)RAY_MISSED_FIELD, out.status, meets);
        stop_distance = CHOOSE64((doubles)0.0, stop_distance, meets);
    }
    const truths fine = out.status == (truths)RAY_OK;

    doubles flight = (doubles)0.0;
    if (STOP == PLANE) {
        Triples normal;
        const truths flies = fine & (!meets | ((ends_on >= (truths)0) & (ends_on != (truths)FACE_COUNT)));
        if (SOME(flies)) {
            const doubles height = surface_each(bounds, FACE_COUNT, sum_of(ahead_of(p, along, d), q), &normal);
            const doubles slope = inner(normal, heading);
            // If the plane is on a face of the box, rounding may put the ray behind the plane.
            const double face_tolerance = 1.0e-3 / (double)greatest(VECTOR(control->cell_rate));
            // The undisturbed ray of a parallel ray never meets the plane: there is no path to compare with.
            const truths parallel = fabs(inner(normal, d)) <= LEAST_SLOPE;
            const truths toward = (height * slope < 0.0) & (fabs(slope) > LEAST_SLOPE) & !parallel;
            const truths arrives = toward | (meets & (fabs(height) < face_tolerance * fabs(slope)));
            flight = CHOOSE64(flight, -height / slope, flies & arrives);
            out.status =
                CHOOSE64(out.status, (truths)RAY_STOP_NOT_REACHED, flies & !arrives & (height != 0.0));
        }
    } else if (STOP == ARC) {
        flight = CHOOSE64(flight, bounds->length - (along + arc), fine);
    }
    const Triples deviation = ahead_of(q, flight, tangent_change);
    along += flight;

    out.opd = work - ambient * arc;
    if (STOP != ARC) {
        // How much further along d than the undisturbed ray the ray meets the stop: computed from the deviation where
        // that is exact, because the difference of two distances would lose its last digits.
        const truths known = (out.status == (truths)RAY_OK) & starts->has_stop;
        doubles further = along - stop_distance;
        if (STOP == PLANE) {
            const double3 normal = VECTOR64(bounds->plane_normal);
            const doubles descent = inner_with(normal, d);
            further = CHOOSE64(further, -inner_with(normal, deviation) / descent, fabs(descent) > LEAST_COSINE);
        } else {
#pragma unroll
            for (int k = 0; k < FACE_COUNT; k++) {
                const truths now = ends_on == (truths)k;
                if (SOME(now)) {
                    const doubles found = detour_each(bounds, k, p, d, deviation, stop_distance, further);
                    further = CHOOSE64(further, found, now);
                }
            }
        }
        out.opd = CHOOSE64(out.opd, work + ambient * further, known);
    }
    out.position = sum_of(ahead_of(p, along, d), deviation);
    out.heading = heading;
    out.optical_path = greater_each(ambient * along + work, (doubles)0.0);
    // Rounding may make it negative if a ray leaves at its start.
    out.arc_length = greater_each(along + arc, (doubles)0.0);
    out.flight = flight;
    return out;
}

// Loop over the lanes that belong to a ray.
#define EACH_RAY(lane) for (int lane = 0; lane < LANES && first + lane < ray_count; lane++)

static inline void write_numbers(__global double *to, int first, int ray_count, doubles numbers)
{
#if LANES > 1
    if (first + LANES <= ray_count) {
#if LANES == 16
        vstore16(numbers, 0, to + first);
#else
        vstore8(numbers, 0, to + first);
#endif
        return;
    }
#endif
    EACH_RAY(lane) {
        to[first + lane] = DOUBLE_AT(numbers, lane);
    }
}

static inline void write_vectors(__global double *to, int first, int ray_count, Triples vectors)
{
    EACH_RAY(lane) {
        vstore3(TRIPLE_AT(vectors, lane), first + lane, to);
    }
}

// Write the requested outputs of rays at their stop, and count the rejected rays, which are to be traced by another
// method. Rays that do not run took no samples.
static inline void write_packet(
    const RayOutputs *outputs,
    const Control *control,
    int first,
    int ray_count,
    const Arrivals *arrival,
    reals step_error,
    truths runs,
    __global int *rejected_count)
{
    const int requested = control->outputs;
    if (requested & OUTPUT_POSITION) {
        write_vectors(outputs->position, first, ray_count, arrival->position);
    }
    if (requested & OUTPUT_DIRECTION) {
        const Triples heading = arrival->heading;
        const doubles size = sqrt(inner(heading, heading));
        const Triples unit = triples_of(heading.x / size, heading.y / size, heading.z / size);
        write_vectors(outputs->direction, first, ray_count, unit);
    }
    if (requested & OUTPUT_OPTICAL_PATH) {
        write_numbers(outputs->optical_path, first, ray_count, arrival->optical_path);
    }
    if (requested & OUTPUT_OPD) {
        write_numbers(outputs->opd, first, ray_count, arrival->opd);
    }
    if (requested & OUTPUT_ARC_LENGTH) {
        write_numbers(outputs->arc_length, first, ray_count, arrival->arc_length);
    }
    if (requested & OUTPUT_STEP_ERROR) {
        write_numbers(outputs->step_error, first, ray_count, TO_DOUBLES(step_error));
    }
    if (requested & (OUTPUT_STEP_COUNT | OUTPUT_EVALUATION_COUNT)) {
        EACH_RAY(lane) {
            const int samples = TRUTH_AT(runs, lane) ? control->sample_count : 0;
            if (requested & OUTPUT_STEP_COUNT) {
                outputs->step_count[first + lane] = samples;
            }
            if (requested & OUTPUT_EVALUATION_COUNT) {
                outputs->evaluation_count[first + lane] = samples;
            }
        }
    }
    EACH_RAY(lane) {
        outputs->status[first + lane] = (int)NUMBER_AT(arrival->status, lane);
    }
    if (SOME(TO_TRUTHS(step_error > control->tolerance))) {
        EACH_RAY(lane) {
            if (REAL_AT(step_error, lane) > control->tolerance) {
                atomic_inc(rejected_count);
            }
        }
    }
}

#endif
