"""Noise of points in east-north, from what the sensor, the settings or each plot tell of it."""

from __future__ import annotations

import numpy as np

from maritrack.geo import polar_cov_to_en
from maritrack.settings import InputConfig
from maritrack.types import BoolArray, FloatArray


def point_noise(range_m: FloatArray, azimuth_rad: FloatArray, config: InputConfig) -> FloatArray | None:
    """East-north covariances (n, 2, 2) from the sigmas of the settings; None where all of them are 0.

    `sigma_m` is a floor in any direction, not an addition: variance along the beam is
    max(sigma_range^2, sigma^2), across it max((r sigma_azimuth)^2, sigma^2).
    """
    floor = config.sigma_m**2
    if max(config.sigma_range_m, config.sigma_azimuth_deg, config.sigma_m) <= 0.0:
        return None
    along = np.full(len(range_m), max(config.sigma_range_m**2, floor))
    across = np.maximum((range_m * np.deg2rad(config.sigma_azimuth_deg)) ** 2, floor)
    return polar_cov_to_en(np.ones(len(range_m)), azimuth_rad, along, across)


def noise_in_space(range_m: FloatArray, config: InputConfig) -> FloatArray | None:
    """Variances (n, 3) of range, azimuth and elevation from the sigmas of the settings; None without all of them."""
    sigmas = (config.sigma_range_m, config.sigma_azimuth_deg, config.sigma_elevation_deg)
    if min(sigmas) <= 0.0:
        return None
    return np.tile(np.square([sigmas[0], *np.deg2rad(sigmas[1:])]), (len(range_m), 1))


def plot_cov_to_en(range_m: FloatArray, azimuth_rad: FloatArray, cov: FloatArray) -> FloatArray:
    """East-north covariances (n, 2, 2) of polar ones with their cross term, to first order.

    `cov` (n, 3) is [range range m^2, range azimuth m rad, azimuth azimuth rad^2]. Without a cross
    term it agrees with `geo.polar_cov_to_en`.
    """
    en = polar_cov_to_en(range_m, azimuth_rad, cov[:, 0], cov[:, 2])
    cross = range_m * cov[:, 1]
    s2, c2 = np.sin(2 * azimuth_rad), np.cos(2 * azimuth_rad)
    return np.asarray(en + cross[:, None, None] * np.stack([np.stack([s2, c2], -1), np.stack([c2, -s2], -1)], -2))


def en_cov_to_plot(range_m: FloatArray, azimuth_rad: FloatArray, cov_m2: FloatArray) -> FloatArray:
    """Polar covariances (n, 3) of east-north ones (n, 2, 2): the inverse of `plot_cov_to_en`."""
    beam = turn_cov(cov_m2, -azimuth_rad)  # north is now along the beam, east across it
    safe = np.maximum(range_m, 1e-9)
    return np.stack([beam[:, 1, 1], beam[:, 0, 1] / safe, beam[:, 0, 0] / safe**2], axis=-1)


def turn_cov(cov_m2: FloatArray, angle_rad: FloatArray | float) -> FloatArray:
    """Covariances (n, 2, 2) of east-north errors after a clockwise turn by the angle, (n,) or one."""
    angle = np.broadcast_to(np.asarray(angle_rad, float), len(cov_m2))
    s, c = np.sin(angle), np.cos(angle)
    turn = np.stack([np.stack([c, s], -1), np.stack([-s, c], -1)], -2)
    turned = turn @ cov_m2 @ np.swapaxes(turn, -1, -2)
    return np.asarray(0.5 * (turned + np.swapaxes(turned, -1, -2)))


def usable_cov(cov: FloatArray) -> BoolArray:
    """Which rows [c00, c01, c11] (n, 3) are covariances: finite, not huge, not negative definite."""
    finite = np.all(np.abs(np.nan_to_num(cov, nan=np.inf)) < 1e12, axis=1)
    c = np.where(finite[:, None], cov, 0.0)
    return np.asarray(finite & (c[:, 0] >= 0) & (c[:, 2] >= 0) & (c[:, 1] ** 2 <= c[:, 0] * c[:, 2] * (1 + 1e-9)))
