"""The old name of the package `aerokernels.focus`, for imports only."""

from aerokernels.old_modules import stand_in

stand_in(__name__, "aerokernels.focus")
