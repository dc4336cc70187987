"""A calibration as a file: the TOML of `--sensors`, with standard deviations as comments and the lags of ships."""

from __future__ import annotations

import json

from maritrack.calibrate.estimate import Calibration


def to_toml(calibration: Calibration) -> str:
    """The text that `process --calibration` reads."""
    lines = [f"# maritrack calibrate, against {calibration.against}. Standard deviations behind +-."]
    for s in calibration.sensors:
        lines += [
            "",
            f"# {s.associations} associations with {s.ships} ships, residuals of {s.rms_m:.0f} m",
            f"[sensors.{json.dumps(s.key)}]",
            f"azimuth_offset_deg = {s.azimuth_offset_deg:.3f}  # +- {s.azimuth_sigma_deg:.3f}",
            f"range_offset_m = {s.range_offset_m:.1f}  # +- {s.range_sigma_m:.1f}",
            f"latency_s = {s.latency_s:.2f}  # +- {s.latency_sigma_s:.2f}",
        ]
    late = [ship for ship in calibration.ships if ship.late]
    if late:
        told = ",".join(f"{ship.id}={ship.lag_s:.1f}" for ship in late)
        lines += ["", "[score]", f"truth_lag_s = {json.dumps(told)}"]
        lines += [f"# {ship.id}: +- {ship.lag_sigma_s:.1f}, {json.dumps(ship.name)}" for ship in late]
    return "\n".join(lines) + "\n"
