"""The order of convergence, fitted."""

import numpy as np


def fitted_order(spacings, errors) -> float:
    """Slope of log error over log spacing."""
    return float(np.polyfit(np.log(spacings), np.log(errors), 1)[0])
