"""Radar video of a quay: one vessel leaves her berth there, another comes to hers; by each tracker, preset `radar`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from maritrack.chain import build_chain, process
from maritrack.config import load_config
from maritrack.recording import kinds_of, open_inputs, open_recording
from maritrack.simulate.record import simulate
from maritrack.simulate.scenes import Scene, load_scene
from maritrack.types import CONFIRMED, STATIONARY, Frame
from tests.unit.scans import OF_CLUSTERS

POINTS = ("jpda", "ec-jpda")  # centroids of the quay pull them: the course of a point says nothing of its size
TURN_S, SCANS = 3.0, 126
SCENE = f"""
title = "quay"
start = 2026-03-01T12:00:00Z
lat_deg = 54.0
lon_deg = 8.0
scans = {SCANS}
[radar]
sac = 7
sic = 9
turn_s = {TURN_S}
spokes = 512
beam_deg = 0.8
cells = 200
cell_m = 10.0
pulse_m = 10.0
unit_range_m = 3000.0
floor_db = 0.0
full_db = 40.0
threshold = 60
sparse_noise = true
[[land]]
name = "quay"
outline_m = [[-600, 1000], [700, 1000], [700, 1100], [-600, 1100]]
[[vessel]]
id = "leaves"
length_m = 100.0
width_m = 20.0
rcs_m2 = 4000.0
waypoints_m = WAY
speed_mps = 5.0
turn_deg_per_s = 3.0
depart_s = 240.0
accel_mps2 = 0.1
[[vessel]]
id = "comes"
length_m = 100.0
width_m = 20.0
rcs_m2 = 4000.0
waypoints_m = [[1300, 600], [400, 940]]
speed_mps = 5.0
brake_mps2 = 0.1
"""


OFF_THE_QUAY = "[[-100, 930], [-200, 920], [-400, 400]]"
ALONG_THE_QUAY = "[[-100, 930], [-350, 925], [-600, 400]]"  # hidden until 230 m from the berth


@pytest.fixture(scope="module", params=[OFF_THE_QUAY, ALONG_THE_QUAY], ids=["off", "along"])
def quay(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, list[Frame]]:
    """The scene and its turns, read from a CAT240 recording of it."""
    folder = tmp_path_factory.mktemp("quay")
    (folder / "quay.toml").write_text(SCENE.replace("WAY", request.param), "utf-8")
    scene, recording = load_scene(folder / "quay.toml"), Path(folder / "quay.cat240")
    simulate(scene, recording, seed=0, ais=False, labels=False)
    octets = open_inputs([recording])
    return scene, list(open_recording(octets, kinds_of(octets), {}, load_config(preset="radar")).frames)


@pytest.mark.parametrize("name", [name for name in OF_CLUSTERS if name not in POINTS])
def test_a_vessel_has_one_id_at_her_berth_and_under_way(name: str, quay: tuple[Scene, list[Frame]]) -> None:
    scene, frames = quay
    chain = build_chain(load_config(preset="radar", sets=[f"tracker_name={name}"]))
    state, held = chain.init(), {vessel.id: [(0, -1, False)] for vessel in scene.vessel}
    for frame in frames:
        state, result = process(chain, state, frame)
        t = result.tracks
        for vessel in scene.vessel:
            at = vessel.course().at(np.array([TURN_S * (frame.k + 0.5)])).position_m[0]
            gap_m = np.where(t.status >= CONFIRMED, np.hypot(*(t.position_m - at).T), np.inf)
            i = int(np.argmin(gap_m)) if len(t) else 0
            near = len(t) > 0 and gap_m[i] < 100.0
            held[vessel.id].append((int(t.id[i]), int(t.status[i]), bool(t.moving[i])) if near else (0, -1, False))
    berth, way = held["leaves"][20:80], held["leaves"][-4:]
    assert {status for _, status, _ in berth} == {STATIONARY}
    assert len({i for i, _, _ in berth + way}) == 1
    assert all(moving for _, _, moving in way)
    way, berth = held["comes"][20:60], held["comes"][80:]
    assert sum(moving for _, _, moving in way) > 20
    assert {status for _, status, _ in berth} == {STATIONARY}
    assert len({i for i, _, _ in way + berth}) == 1
