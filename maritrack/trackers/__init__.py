"""The table of trackers: a name and what builds it from a configuration."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

from maritrack.settings import Config
from maritrack.trackers import engm_phd, jpda, pmbm, smc_phd
from maritrack.trackers.gm_phd import GmPhd
from maritrack.trackers.ipda import Ipda
from maritrack.trackers.jipda import Jipda
from maritrack.trackers.pakf import Pakf
from maritrack.trackers.phd import Phd
from maritrack.trackers.sprt import Sprt
from maritrack.types import Clusters, Points, Scan, Tracks, Truth


class Tracker(Protocol):
    """Settings with three functions; the state is a value that is handed along."""

    def init(self) -> Any: ...

    def update(self, state: Any, scan: Scan, points: Points, clusters: Clusters) -> tuple[Any, Any]: ...

    def estimate(self, state: Any) -> Tracks: ...


@runtime_checkable
class Told(Protocol):
    """A tracker that also starts tracks where AIS tells of ships."""

    def started(self, state: Any, truth: Truth, scan: Scan) -> Any: ...


TRACKERS: dict[str, Callable[[Config], Tracker]] = {
    "sprt": Sprt,
    "ipda": Ipda,
    "jipda": Jipda,
    "cb-giw-phd": Phd,
    "pakf-jpda": Pakf,
    "jpda": jpda.jpda,
    "ec-jpda": jpda.Jpda,
    "gm-phd": GmPhd,
    "smc-phd": smc_phd.tracker,
    "engm-phd": engm_phd.tracker,
    "giw-pmbm": pmbm.giw_pmbm,
    "gp-pmbm": pmbm.gp_pmbm,
}
