// Sums over groups of GROUP rays: a work-group sums one group, and each work-item every WORK_GROUP-th ray of the group.
// A replicate begins with a new group, so that no group has rays of two replicates.
#ifndef GROUPS_H
#define GROUPS_H

#include "constants.h"
#include "ray_status.h"

// Work-items of a work-group, which the host sets; no fewer than SUM_COUNT.
#ifndef WORK_GROUP
#define WORK_GROUP 64
#endif

#define WORST 10  // the moment that is a maximum, not a sum

// Whether a ray of this status reached the stop, see aerokernels/tracing/status.py.
#define HAS_ARRIVED(status) \
    ((status) == RAY_OK || (status) == RAY_LEFT_DISTURBED_AIR || (status) == RAY_TOLERANCE_NOT_MET)

// First ray of a group, and one past its last; they are the same where there is no such group.
int2 group_span(int group, int group_count, int per_replicate)
{
    const int groups = (per_replicate + GROUP - 1) / GROUP;
    const int replicate = group / groups;
    const int begin = (group - replicate * groups) * GROUP;
    const int count = group < group_count ? min(GROUP, per_replicate - begin) : 0;
    return (int2)(replicate * per_replicate + begin, replicate * per_replicate + begin + count);
}

#endif
