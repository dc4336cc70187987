"""The check as documents: JSON for programs, GeoJSON for charts, and what there is to draw."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np

from maritrack.aischeck.check import Check
from maritrack.aischeck.judge import DISPLACED, UNSEEN, Verdict, misfits
from maritrack.aischeck.seeing import EDGES_M
from maritrack.aischeck.strangers import Stranger
from maritrack.geo import en_to_geodetic
from maritrack.types import FloatArray

LATE_S = 10.0  # a lag from this on is something to report
KNOTS = 3600.0 / 1852.0
READING = (
    "p_if_there is the probability of as few echoes in as many looks, were the ship where AIS says: beta-binomial "
    "about the mean of other ships at its ranges, with the spread between ships of this run, and looks counted for "
    "less where neighbouring ones are alike. A ship is called unseen below the limit, and only where it has no track "
    "and not more echoes than places beside it. p_by_chance is that of as many echoes, were nothing there, about the "
    "share of eight places beside it at the same range. Only ships that are confirmed, or have an echo, tell what is "
    "to be expected: ships that are never seen do not, so it is the probability for ships like those."
)


def finding_rows(check: Check) -> list[dict[str, Any]]:
    """What there is to look at, the gravest first; each with `kind`, `ship` or `track`, and `what` in words."""
    rows: list[dict[str, Any]] = []
    for one in check.verdicts:
        base = {"ship": one.id, "name": one.name}
        position, velocity = misfits(one)
        if one.verdict in (UNSEEN, DISPLACED):
            rows.append({"kind": one.verdict, **base, "what": one.why + _or_another(one)})
        if position:
            far = math.hypot(*one.offset_m)
            rows.append(
                {"kind": "position", **base, "what": f"{far:.0f} m off its track, {one.offset_sigmas:.1f} sigma"}
            )
        if velocity:
            fast = math.hypot(*one.velocity_mps) * KNOTS
            what = f"course and speed {fast:.1f} kn off its track's, {one.velocity_sigmas:.1f} sigma"
            rows.append({"kind": "course", **base, "what": what})
        if abs(one.lag_s) >= LATE_S:
            rows.append(
                {"kind": "late", **base, "what": f"its reports are late by {one.lag_s:.0f} s{_or_another(one)}"}
            )
    rows += [
        {"kind": "no-ais", "track": one.track, "what": _stranger_words(one)}
        for one in check.strangers
        if not one.lobe_of
    ]
    names = {ship.id: ship.name for ship in check.ships}
    for jump in check.jumps:
        how = "and back" if jump.what == "single" else "and stays"
        away = "far" if math.isnan(jump.off_m) else f"{jump.off_m:.0f} m"
        what = f"leaps {away} off its way {how}, {_clock(jump.t_ns)}"
        rows.append({"kind": "jump", "ship": jump.id, "name": names.get(jump.id, ""), "what": what})
    order = ("unseen", "displaced", "no-ais", "jump", "position", "course", "late")
    return sorted(rows, key=lambda row: order.index(row["kind"]))


def _or_another(one: Verdict) -> str:
    """What a convoy leaves open: the tracks that go as a ship does besides the one that was chosen."""
    if not one.doubles:
        return ""
    return f"; or it is track {', '.join(map(str, one.doubles[:5]))}, as in a convoy"


def document(check: Check, *, run: str, ais: str) -> dict[str, Any]:
    """All of it, with the numbers that each word rests on."""
    low, high = check.seeing.interval()
    p, n = check.seeing.p_detect(), check.seeing.looks.sum(axis=0)
    rings = [
        {
            "from_m": float(EDGES_M[i]), "to_m": float(EDGES_M[i + 1]),
            "ships": int((check.seeing.looks[:, i] > 0).sum()), "looks": int(n[i]),
            "hits": int(check.seeing.hits[:, i].sum()), "p_detect": float(p[i]),
            "low": float(low[i]), "high": float(high[i]),
        }
        for i in np.flatnonzero(n).tolist()
    ]  # fmt: skip
    verdicts = [one.verdict for one in check.verdicts]
    return {
        "run": run, "run_id": check.run_id, "ais": ais, "scans": check.scans,
        "ships": [_ship(check, one) for one in check.verdicts],
        "tracks_without_ais": [_stranger(check, one) for one in check.strangers],
        "jumps": [
            {"ship": j.id, "time": _clock(j.t_ns), "off_m": j.off_m, "what": j.what, **_place(check, j.position_m)}
            for j in check.jumps
        ],
        "findings": finding_rows(check), "counts": {v: verdicts.count(v) for v in sorted(set(verdicts))},
        "ships_not_looked_at": check.elsewhere,
        "seeing": {"rings": rings, "looks_worth_one": check.seeing.independent, "spread": check.seeing.spread},
        "azimuth": {"off_deg": check.azimuth_deg, "sigma_deg": check.azimuth_sigma_deg},
        "limits": {
            "p_unseen": check.options.rules.p_unseen, "p_echo": check.options.rules.p_echo,
            "azimuth_sigma_deg": check.options.azimuth_sigma_deg, "max_lag_s": check.options.max_lag_s,
            "max_offset_m": check.options.max_offset_m,
        },
        "reading": READING, "warnings": warnings(check),
    }  # fmt: skip


def warnings(check: Check) -> dict[str, int]:
    """What was left out of the AIS, and what of the archive can't be read, by code."""
    found: dict[str, int] = {}
    for damage in check.damage:
        found[damage.code] = found.get(damage.code, 0) + damage.count
    return dict(sorted(found.items()))


def hints(check: Check) -> list[str]:
    """What would make the check better."""
    told = []
    off, sigma = check.azimuth_deg, check.options.azimuth_sigma_deg
    if abs(off) > sigma and abs(off) > 2.0 * check.azimuth_sigma_deg:  # nan, which never is: one ship alone
        told.append(f"confirmed ships lie {off:+.1f} degrees off their tracks: `maritrack calibrate` first")
    if not check.verdicts:
        told.append("the radar looked at no ship of this AIS: another day or another place?")
    return told


def geojson(check: Check) -> str:
    """Ways of the ships as AIS told them, tracks without AIS, displacements and leaps. Needs an origin."""
    features = []
    index = {ship.id: s for s, ship in enumerate(check.ships)}
    for one in check.verdicts:
        way = way_of(check, index[one.id])
        features.append(_feature(check, way, {"what": "ship", **_short(one)}))
        if one.displaced is not None:
            place = np.array(one.place_m)
            line = np.stack([place, place + one.displaced.offset_m])
            features.append(_feature(check, line, {"what": "displacement", "id": one.id, "track": one.displaced.track}))
    for stranger in check.strangers:
        way = track_way(check, stranger.track)
        features.append(_feature(check, way, {"what": "track without AIS", **_stranger(check, stranger)}))
    for jump in check.jumps:
        told = {"what": "leap", "id": jump.id, "time": _clock(jump.t_ns)}
        features.append(_feature(check, np.array([jump.position_m]), told))
    lines = ",\n".join(json.dumps(feature, ensure_ascii=False) for feature in features)
    return '{"type": "FeatureCollection", "features": [\n' + lines + "\n]}\n"


def way_of(check: Check, ship: int) -> FloatArray:
    """Where AIS said that a ship was (n, 2) at each look."""
    return np.asarray(check.looks.position_m[check.looks.ship == ship])


def track_way(check: Check, track: int) -> FloatArray:
    """Where a track was (n, 2)."""
    return np.asarray(check.rows.position_m[check.rows.id == track])


def _feature(check: Check, way: FloatArray, properties: Mapping[str, Any]) -> dict[str, Any]:
    assert check.origin is not None
    lat, lon = en_to_geodetic(check.origin, way)
    places = np.round(np.stack([lon, lat], axis=-1), 7).tolist()
    kind = (
        {"type": "Point", "coordinates": places[0]}
        if len(places) == 1
        else {"type": "LineString", "coordinates": places}
    )
    return {"type": "Feature", "properties": _finite(properties), "geometry": kind}


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    return [_finite(item) for item in value] if isinstance(value, (list, tuple)) else value


def _short(one: Verdict) -> dict[str, Any]:
    return {
        "id": one.id,
        "name": one.name,
        "verdict": one.verdict,
        "why": one.why,
        "looks": one.looks,
        "hits": one.hits,
    }


def _ship(check: Check, one: Verdict) -> dict[str, Any]:
    members = [i for chain in one.tracks for i in check.members.get(chain, (chain,))]
    displaced = None
    if one.displaced is not None:
        d = one.displaced
        east, north = d.offset_m
        displaced = {"track": d.track, "scans": d.scans, "offset_east_m": east, "offset_north_m": north,
                     "sigma_m": d.sigma_m}  # fmt: skip
    return {
        **_short(one), "hidden_looks": one.hidden, "echoes_beside": one.beside, "p_detect": one.p_detect,
        "p_if_there": one.p_so_few, "p_by_chance": one.p_by_chance, "matched_scans": one.matched, "tracks": members,
        "lag_s": one.lag_s, "speed_kn": one.speed_mps * KNOTS, "range_min_m": one.range_m[0],
        "range_max_m": one.range_m[1], "offset_east_m": one.offset_m[0], "offset_north_m": one.offset_m[1],
        "offset_sigmas": one.offset_sigmas, "velocity_off_kn": math.hypot(*one.velocity_mps) * KNOTS,
        "velocity_sigmas": one.velocity_sigmas, "displaced": displaced,
        "tracks_alike": list(one.doubles), **_place(check, one.place_m),
    }  # fmt: skip


def _stranger(check: Check, one: Stranger) -> dict[str, Any]:
    first_ns, last_ns = (check.start_ns + round(t_s * 1e9) for t_s in (one.first_s, one.last_s))
    return {
        "track": one.track, "tracks": list(check.members.get(one.track, (one.track,))), "scans": one.scans,
        "from": _clock(first_ns), "to": _clock(last_ns),
        "speed_kn": one.speed_mps * KNOTS, "course_deg": math.degrees(one.course_rad), "range_min_m": one.range_m[0],
        "range_max_m": one.range_m[1], "side_lobe_of": one.lobe_of or None, **_place(check, one.to_m),
    }  # fmt: skip


def _stranger_words(one: Stranger) -> str:
    return (
        f"goes {one.speed_mps * KNOTS:.1f} kn on {math.degrees(one.course_rad):03.0f} degrees for {one.scans} scans, "
        f"{one.range_m[0]:.0f} to {one.range_m[1]:.0f} m away"
    )


def _place(check: Check, at: tuple[float, float]) -> dict[str, Any]:
    told: dict[str, Any] = {"east_m": at[0], "north_m": at[1]}
    if check.origin is not None:
        lat, lon = en_to_geodetic(check.origin, np.array([at]))
        told |= {"lat_deg": float(lat[0]), "lon_deg": float(lon[0])}
    return told


def _clock(t_ns: int) -> str:
    """UTC; the time of day alone where there is no date."""
    moment = datetime.fromtimestamp(t_ns // 10**9, UTC)
    return moment.strftime("%H:%M:%S") if t_ns < 365 * 86_400 * 10**9 else moment.strftime("%Y-%m-%dT%H:%M:%SZ")
