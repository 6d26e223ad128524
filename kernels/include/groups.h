// Sums over groups of GROUP rays: a work-group sums one group, each of its work-items every WORK_GROUP-th ray of it.
#ifndef GROUPS_H
#define GROUPS_H

#include "constants.h"
#include "ray_status.h"

// Work-items of a work-group, which the host sets; no fewer than MOMENT_COUNT.
#ifndef WORK_GROUP
#define WORK_GROUP 64
#endif

// One past the last ray of a group; its first where there is no such group.
int group_stop(int group, int group_count, int ray_count)
{
    const int begin = group * GROUP;
    return group < group_count ? begin + min(GROUP, ray_count - begin) : begin;
}

#endif
