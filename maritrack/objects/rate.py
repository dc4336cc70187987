"""How many points an object gives in a scan: Poisson, its mean a gamma density of shape a and inverse scale b.

Granstroem, Orguner 2012. Arrays `rate` (n, 2) hold a and b of each object.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

from maritrack.types import FloatArray


def predict(rate: FloatArray, window: float) -> FloatArray:
    """Rates (n, 2) a scan later: the same mean, as uncertain as `window` scans leave it."""
    return rate * (1.0 - 1.0 / window)


def log_count(rate: FloatArray, count: FloatArray) -> FloatArray:
    """Log of the likelihood (k,) of so many points, without the n! of their order: a negative binomial's."""
    a, b = rate[..., 0], rate[..., 1]
    return np.asarray(gammaln(a + count) - gammaln(a) + a * np.log(b) - (a + count) * np.log(b + 1.0))


def update(rate: FloatArray, count: FloatArray) -> FloatArray:
    """Rates (k, 2) after so many points (k,)."""
    return np.stack([rate[..., 0] + count, rate[..., 1] + 1.0], axis=-1)


def no_points(rate: FloatArray) -> FloatArray:
    """Probability (n,) that an object in sight gives no point: (b / (b + 1))^a."""
    return np.asarray(np.exp(-rate[..., 0] * np.log1p(1.0 / rate[..., 1])))


def missed(rate: FloatArray, p_detect: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Probability (n,) that nothing comes of an object, and the rates (n, 2) given that.

    Out of sight, 1 - P_D, or in sight without a point, P_D (b / (b + 1))^a. Of the two gamma densities one is left,
    with the same shape and the same mean of the inverse scale's reciprocal.
    """
    a, b = rate[:, 0], rate[:, 1]
    none = p_detect * no_points(rate)
    q = 1.0 - p_detect + none
    with np.errstate(invalid="ignore", divide="ignore"):
        inverse = ((1.0 - p_detect) / b + none / (b + 1.0)) / q
    return q, np.stack([a, np.where(q > 0.0, 1.0 / np.where(q > 0.0, inverse, 1.0), b)], axis=1)
