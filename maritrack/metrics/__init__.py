"""How far the tracks are from the truth."""

from maritrack.metrics.gospa import gospa
from maritrack.metrics.ospa import ospa
from maritrack.metrics.tgospa import t_gospa

__all__ = ["gospa", "ospa", "t_gospa"]
