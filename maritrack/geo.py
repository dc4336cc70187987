"""Angles, polar coordinates, local east-north and geodetic positions.

The only place that knows the conventions: azimuth is clockwise from true north, in radians;
east = r sin(azimuth), north = r cos(azimuth). Positions are metres in the plane that touches
WGS84 at the origin of the run.
"""

from __future__ import annotations

import numpy as np

from maritrack.types import BoolArray, FloatArray, IntArray, Mask, Origin, Scan

TWO_PI = 2.0 * np.pi
PIXELS = 1 << 30  # of a grid in each direction, along an axis
C_MPS = 299_792_458.0


def wrap(angle_rad: FloatArray) -> FloatArray:
    """The angle in [-pi, pi): how every difference of angles is taken."""
    return np.asarray((np.asarray(angle_rad) + np.pi) % TWO_PI - np.pi, dtype=np.float64)


def wrap_positive(angle_rad: FloatArray) -> FloatArray:
    """The angle in [0, 2 pi)."""
    wrapped = np.asarray(angle_rad, dtype=np.float64) % TWO_PI
    return np.where(wrapped >= TWO_PI, 0.0, wrapped)  # -1e-17 % 2 pi rounds up to 2 pi


def polar_to_en(range_m: FloatArray, azimuth_rad: FloatArray) -> FloatArray:
    """East-north offsets (n, 2) of points at range and azimuth.

    The paper writes (r cos, r sin) with the mathematical angle; ours is nautical.   Eq: polar-1
    """
    return np.stack([range_m * np.sin(azimuth_rad), range_m * np.cos(azimuth_rad)], axis=-1)


def en_to_polar(offset_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Range (n,) and azimuth (n,) in [0, 2 pi) of east-north offsets (n, 2)."""
    east, north = offset_m[..., 0], offset_m[..., 1]
    return np.hypot(east, north), wrap_positive(np.arctan2(east, north))


def polar_cov_to_en(
    range_m: FloatArray, azimuth_rad: FloatArray, var_range_m2: FloatArray, var_azimuth_rad2: FloatArray
) -> FloatArray:
    """East-north covariances (n, 2, 2) of independent range and azimuth errors, to first order."""
    s, c = np.sin(azimuth_rad), np.cos(azimuth_rad)
    across_m2 = range_m**2 * var_azimuth_rad2
    ee = s * s * var_range_m2 + c * c * across_m2
    nn = c * c * var_range_m2 + s * s * across_m2
    en = s * c * (var_range_m2 - across_m2)
    return np.stack([np.stack([ee, en], -1), np.stack([en, nn], -1)], -2)


def geodetic_to_en(origin: Origin, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
    """East-north (n, 2) of WGS84 positions at height zero, in the tangent plane of the origin."""
    import pymap3d  # not at the top: it costs a tenth of a second that `--help` need not pay

    east, north, _ = pymap3d.geodetic2enu(
        np.asarray(lat_deg, float), np.asarray(lon_deg, float), 0.0, origin.lat_deg, origin.lon_deg, 0.0
    )
    return np.stack([np.asarray(east, float), np.asarray(north, float)], axis=-1)


def en_to_geodetic(origin: Origin, position_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Latitude (n,) and longitude (n,) in degrees of east-north positions (n, 2)."""
    import pymap3d

    lat, lon, _ = pymap3d.enu2geodetic(
        position_m[..., 0], position_m[..., 1], np.zeros(position_m.shape[:-1]), origin.lat_deg, origin.lon_deg, 0.0
    )
    return np.asarray(lat, float), np.asarray(lon, float)


def visible(scan: Scan, position_m: FloatArray, roi_min_m: float, roi_max_m: float) -> BoolArray:
    """Whether this scan looked at each position (n, 2)."""
    r, azimuth = en_to_polar(position_m - scan.position_m)
    seen = (r >= roi_min_m) & (r <= min(scan.sensor.max_range_m, roi_max_m))
    if scan.swept is not None:
        seen &= scan.swept[np.minimum((azimuth / TWO_PI * len(scan.swept)).astype(int), len(scan.swept) - 1)]
    return np.asarray(seen)


def pixel_key(position_m: FloatArray, pixel_m: float, corner_m: tuple[float, float] = (0.0, 0.0)) -> IntArray:
    """The pixel of each position (n, 2) as one number, row by row from the south; far away all are the last one."""
    step = np.floor((position_m - np.asarray(corner_m)) / pixel_m)
    column, row = np.clip(step, -PIXELS, PIXELS - 1).astype(np.int64).T + PIXELS
    return np.asarray(row * (2 * PIXELS) + column)


def pixel_centre(key: IntArray, pixel_m: float, corner_m: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    """East-north (n, 2) of the centres of pixels."""
    row, column = np.divmod(key, 2 * PIXELS)
    return np.asarray((np.stack([column, row], axis=-1) - PIXELS + 0.5) * pixel_m + np.asarray(corner_m))


def in_mask(mask: Mask | None, position_m: FloatArray) -> BoolArray:
    """Whether each position (n, 2) lies in a pixel of the mask."""
    if mask is None or len(mask.key) == 0:
        return np.zeros(len(position_m), bool)
    key = pixel_key(position_m, mask.pixel_m, mask.corner_m)
    at = np.minimum(np.searchsorted(mask.key, key), len(mask.key) - 1)
    return np.asarray(mask.key[at] == key)
