"""Which ship carries a radar, and where it is over time: settings, AIS or NMEA of own ship."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from maritrack.errors import InputError
from maritrack.io.ais import AisDocument, read_ais
from maritrack.io.nmea import read_nmea
from maritrack.io.pose import PoseTrack
from maritrack.io.truth import document_kind
from maritrack.settings import InputConfig
from maritrack.types import Origin


def fixed_origin(settings: InputConfig) -> Origin | None:
    """Where the settings place the radar."""
    if math.isnan(settings.lat_deg) or math.isnan(settings.lon_deg):
        return None
    return Origin(settings.lat_deg, settings.lon_deg)


def carriers_of(
    side: Mapping[str, bytes], settings: Sequence[InputConfig], origin: Origin | None
) -> dict[str, AisDocument]:
    """Reports of each ship that settings name as the carrier of a sensor, all in the plane of one origin."""
    found: dict[str, AisDocument] = {}
    for ship in dict.fromkeys(one.own_ship for one in settings if one.own_ship):
        kinds = {n: document_kind(side[n], name=n) for n in ("own-ship", "truth") if n in side}
        name = next((n for n, kind in kinds.items() if kind == "ais"), None)
        if kinds.get("own-ship") == "nmea" and not found:  # of one ship, whatever its name
            document = read_nmea(side["own-ship"], name="own-ship", date=settings[0].date, origin=origin)
        elif name is not None:
            document = read_ais(side[name], name=name, date=settings[0].date, origin=origin, own_ship=ship)
        else:
            raise InputError(f"own_ship = '{ship}': no AIS reports to find it in", hint="pass them with --own-ship")
        origin, found[ship] = document.origin, document
    return found


def own_ship(side: Mapping[str, bytes], settings: InputConfig, origin: Origin | None) -> AisDocument | None:
    """AIS that places the radar: the document given for it, else an entry of the truth marked as own ship."""
    if "own-ship" in side and document_kind(side["own-ship"], name="own-ship", own=True) == "nmea":
        return read_nmea(side["own-ship"], name="own-ship", date=settings.date, origin=origin)
    if "own-ship" in side:
        document = read_ais(side["own-ship"], name="own-ship", date=settings.date, origin=origin)
        if document.own is None and len(document.reference.ids) == 1:
            only = document.reference.ids[0]
            document = read_ais(side["own-ship"], name="own-ship", date=settings.date, origin=origin, own_ship=only)
        if document.own is None:
            hint = "mark it in a column is_own_ship, or give a table of that ship alone"
            raise InputError("own-ship: which ship carries the radar?", hint)
        return document
    if "truth" in side and document_kind(side["truth"], name="truth") == "ais":
        document = read_ais(side["truth"], name="truth", date=settings.date, origin=origin)
        return document if document.own is not None else None
    return None


def platform(ais: AisDocument | None, settings: InputConfig, origin: Origin | None) -> PoseTrack | None:
    """Where the platform is over time. A position given for a fixed radar beats reports of a ship."""
    if fixed_origin(settings) is not None or ais is None or ais.own is None:
        return None
    return pose_of(ais)


def pose_of(document: AisDocument) -> PoseTrack:
    """Where own ship of a document is over time."""
    if document.own is None:
        raise InputError("own-ship: which ship carries the radar?")
    return PoseTrack.from_reports(document.own.t_ns, document.own.position_m, document.own.heading_rad)
