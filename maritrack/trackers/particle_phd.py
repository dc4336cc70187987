"""What the PHD filters of particles have in common; how the prior is made and updated tells them apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from maritrack.settings import Config
from maritrack.trackers import intensity, labels, particles, readings
from maritrack.trackers.intensity import Intensity, IntensityState
from maritrack.trackers.particles import Drawn
from maritrack.trackers.readings import Readings
from maritrack.trackers.steps import Info
from maritrack.types import Clusters, Points, Scan, Tracks

Predict = Callable[[IntensityState, Intensity, float, Config], Intensity]  # state, births, seconds
Update = Callable[[Intensity, Readings, Scan, Points, int, int, Config], Drawn]  # prior, ..., time in ns, scan number


@dataclass(frozen=True, slots=True)
class ParticlePhd:
    """Settings and the two steps; the state holds the particles and, by label, the tracks."""

    config: Config
    predicted: Predict
    updated: Update

    def init(self) -> IntensityState:
        """No object."""
        return intensity.begin(self.config)

    def update(
        self, state: IntensityState, scan: Scan, points: Points, clusters: Clusters
    ) -> tuple[IntensityState, Info]:
        """Make the prior of survivors and births, update it with all measurements, draw particles, find objects."""
        config = self.config
        clock = intensity.clock(state, scan)
        born, label = intensity.labelled(intensity.newborn(state, clock[1], config), state.tracks.next_id)
        prior = self.predicted(state, born, clock[1], config)
        seen = readings.read(scan, points, clusters, state.tracks, config)
        drawn = self.updated(prior, seen, scan, points, clock[0], state.k, config)
        return particles.carried_on(state, drawn, label, clock, seen, scan, points, clusters, config)

    def estimate(self, state: IntensityState) -> Tracks:
        """Objects heavier than `intensity.extract_weight` are confirmed."""
        return labels.estimate(state, self.config)
