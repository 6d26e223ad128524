// Status codes of rays.
// Written by scripts/kernel_headers from aerokernels/tracing/status.py: change it there.
#ifndef RAY_STATUS_H
#define RAY_STATUS_H

#define RAY_OK                 0 // the ray reached the stop
#define RAY_MISSED_FIELD       1 // the ray never meets the field's box, so it cannot leave it
#define RAY_STOP_NOT_REACHED   2 // the plane lies behind the ray or beside it, or the ray was turned away from it
#define RAY_HIT_BODY           3 // the ray met the body and ends on its surface
#define RAY_INSIDE_BODY        4 // the ray starts behind the body's surface and never leaves it within the field's box
#define RAY_MAX_STEPS          5 // the ray took as many steps as allowed and had not arrived
#define RAY_NOT_FINITE         6 // a number overflowed or was not a number
#define RAY_LEFT_DISTURBED_AIR 7 // the ray reached the stop, but part of its way lies outside the field's box beside air that is still disturbed, so that its optical path holds the known air only
#define RAY_TOLERANCE_NOT_MET  8 // the ray reached the stop, but its own error estimate (step_error) is above the tolerance asked for

#endif
