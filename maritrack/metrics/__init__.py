"""How far the tracks are from the truth, and the clusters."""

from maritrack.metrics.clusters import adjusted_rand_index
from maritrack.metrics.gospa import gospa
from maritrack.metrics.ospa import ospa
from maritrack.metrics.tgospa import t_gospa

__all__ = ["adjusted_rand_index", "gospa", "ospa", "t_gospa"]
