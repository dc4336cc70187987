"""A folder, ZIP or TAR of radar images as a source of frames: a scan of each image that can be used."""

from __future__ import annotations

import math
import tarfile
from collections.abc import Iterator

import numpy as np

from maritrack.errors import ConfigError, InputError
from maritrack.imagesettings import ImageConfig
from maritrack.io.images.decode import LeftOut, decode
from maritrack.io.images.mask import picture_mask, reach_px
from maritrack.io.images.pack import MOST_OCTETS, REASON, ChunkFile
from maritrack.io.images.palette import Palette
from maritrack.io.images.times import Clock
from maritrack.io.pieces import Piece, frames_by_time
from maritrack.io.pose import PoseTrack
from maritrack.io.source import Octets
from maritrack.settings import InputConfig
from maritrack.types import BoolArray, Damage, Frame, Origin, Picture, Scan, Sensor

WINDOW = 8  # images may be so far out of order
TOLD = {
    "no-image": ("no-image", "a file that is no PNG, JPEG or TIFF image"),
    "too-large": ("image-too-large", f"a file of more than {MOST_OCTETS >> 20} MiB"),
    "unreadable": ("image-unreadable", "a file that can't be read"),
    "bomb": ("zip-bomb", "the ZIP archive unpacks to far more than itself: the rest is left out"),
}


class ImageSource:
    """The images of a TAR stream as frames in order of time.

    An image that can't be used is no scan: it is damage, by its reason. `pose` is where the radar is and where its
    bow points (None: at the origin, no heading). Raises ConfigError where the radar's place in the images or their
    scale is not told, InputError for head-up images without a heading.
    """

    kind = "images"

    def __init__(
        self,
        octets: Octets,
        config: InputConfig,
        images: ImageConfig,
        *,
        pose: PoseTrack | None = None,
        origin: Origin | None = None,
        strict: bool = False,
    ) -> None:
        if not images.centre_px or not images.pixel_m:
            missing = "images.centre_px" if not images.centre_px else "images.pixel_m"
            raise ConfigError(f"{octets.name}: {missing} is not told", hint=f"maritrack inspect-images {octets.name}")
        self.origin = origin
        self.unclaimed: tuple[Damage, ...] = ()
        self._octets, self._config, self._images, self._strict = octets, config, images, strict
        self._pose = pose if pose is not None else PoseTrack.fixed()

    def frames(self) -> Iterator[Frame]:
        """Frames from 0 on; each carries the octets read for it."""
        self.unclaimed = yield from frames_by_time(
            self._pieces(), channel=self._octets.channel, name=self._octets.name, window=WINDOW, strict=self._strict
        )

    def _pieces(self) -> Iterator[Piece]:
        reader = _Reader(self._config, self._images, self._pose, self._octets.name)
        stream = ChunkFile(iter(self._octets.chunks))
        at = 0
        for name, data, reason in members(stream):
            scan, damage = reader.scan(name, data, reason, at)
            octets = stream.taken()
            at += len(octets)
            yield Piece(octets, scan=scan, damage=damage)
        stream.read()
        yield Piece(stream.taken())


def members(stream: ChunkFile) -> Iterator[tuple[str, bytes, str]]:
    """Name and octets of each file in a TAR, and why they are left out; what ends too soon as a last, nameless one."""
    try:
        with tarfile.open(fileobj=stream, mode="r|", encoding="utf-8", errors="replace") as tar:
            for info in tar:
                tar.members = []  # type: ignore[attr-defined] # else it remembers them all
                if not info.isreg():
                    continue
                reason = info.pax_headers.get(REASON, "")
                if info.size > MOST_OCTETS:
                    yield info.name, b"", "too-large"
                    continue
                file = tar.extractfile(info)
                data = file.read() if file is not None else b""
                if len(data) < info.size:
                    yield "", b"", f"the stream ends within {info.name}"
                    return
                yield info.name, data, reason
    except (tarfile.TarError, EOFError, OSError, ValueError, IndexError) as error:
        yield "", b"", f"the stream of images is damaged: {error}"


class _Reader:
    """Images to scans, one after the other: size, mask and colours are those of the first."""

    def __init__(self, config: InputConfig, images: ImageConfig, pose: PoseTrack, where: str) -> None:
        self._config, self._images, self._pose, self._where = config, images, pose, where
        self._clock, self._palette = Clock(images, config.date), Palette(images)
        self._size = images.size_px
        self._mask: BoolArray | None = None

    def scan(self, name: str, data: bytes, reason: str, at: int) -> tuple[Scan | None, tuple[Damage, ...]]:
        """The scan of a file, or what is wrong with it."""
        if not name:
            return None, (Damage("images-broken", at, reason),)
        if reason:
            code, message = TOLD.get(reason, TOLD["unreadable"])
            return None, (Damage(code, at, f"{name}: {message}"),)
        if name.lower().endswith(".csv"):
            return None, self._learn(name, data, at)
        t_ns = self._clock.time_ns(name)
        if t_ns is None:
            return None, (Damage("image-time", at, f"{name}: no time in its name or in the table"),)
        try:
            pixels = decode(data, max_pixels=self._images.max_pixels, size_px=self._size)
        except LeftOut as error:
            return None, (Damage(error.code, at, f"{name}: {error}"),)
        height, width = pixels.shape[:2]
        if self._mask is None:
            self._size, self._mask = (width, height), picture_mask(self._images, width, height)
            if not self._mask.any():
                raise ConfigError(f"{self._where}: nothing is left of its images by the mask of the settings")
        strength = self._palette.strength(pixels) * self._mask
        return self._scan(strength, t_ns), ()

    def _learn(self, name: str, data: bytes, at: int) -> tuple[Damage, ...]:
        try:
            self._clock.learn(data, name)
        except InputError as error:
            return (Damage("image-table", at, f"not a table of times: {error}"),)
        return ()

    def _scan(self, strength: np.ndarray, t_ns: int) -> Scan:
        config, images = self._config, self._images
        then = np.array([t_ns - round(config.latency_s * 1e9)])
        heading = float(self._pose.heading(then)[0])
        up_rad = math.radians(config.azimuth_offset_deg)
        if config.stabilised == "head":
            if math.isnan(heading):
                hint = "give --own-ship, or say input.stabilised = north"
                raise InputError(f"{self._where}: images with the bow up, but no heading", hint)
            up_rad += heading
        height, width = strength.shape
        reach_m = reach_px(images, width, height) * images.pixel_m
        sensor = Sensor(
            id=config.sensor or "radar", range_res_m=images.pixel_m, azimuth_res_rad=0.0,
            max_range_m=min(reach_m, config.roi_max_m),
        )  # fmt: skip
        centre = (images.centre_px[0], images.centre_px[1])
        return Scan(
            sensor, t_ns=t_ns, t_start_ns=t_ns, position_m=self._pose.position(then)[0], heading_rad=heading,
            picture=Picture(strength, centre, images.pixel_m, up_rad),
        )  # fmt: skip
