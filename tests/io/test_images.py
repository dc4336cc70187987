"""Folders and archives of radar images: which frames come of them, when they were taken, and what damage does."""

from __future__ import annotations

import io
import math
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from maritrack.errors import ConfigError, InputError
from maritrack.imagesettings import ImageConfig
from maritrack.io import sniff
from maritrack.io.images import pack
from maritrack.io.images.decode import LeftOut, decode
from maritrack.io.images.mask import picture_mask, reach_px
from maritrack.io.images.palette import Palette
from maritrack.io.images.source import ImageSource
from maritrack.io.images.times import Clock
from maritrack.io.octets import octets_from_bytes, octets_from_file, whole
from maritrack.io.pose import PoseTrack
from maritrack.settings import InputConfig
from maritrack.types import Frame

Colour = tuple[int, int, int]
PLAIN = ImageConfig(centre_px=(20.0, 15.0), pixel_m=10.0)


def png(
    *, width: int = 40, height: int = 30, colour: tuple[int, int, int] = (200, 200, 200), fmt: str = "PNG"
) -> bytes:
    """An image of one colour with a black corner."""
    pixels = np.full((height, width, 3), colour, np.uint8)
    pixels[:3, :3] = 0
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, fmt)
    return out.getvalue()


def folder(path: Path, files: Mapping[str, bytes]) -> Path:
    path.mkdir(exist_ok=True)
    for name, data in files.items():
        (path / name).write_bytes(data)
    return path


def zipped(path: Path, files: Mapping[str, bytes], *, how: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", how) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def frames_of(path: Path, images: ImageConfig = PLAIN, **more: object) -> list[Frame]:
    config = InputConfig(**more)  # type: ignore[arg-type]
    return list(ImageSource(octets_from_file(path, "/input/images"), config, images).frames())


def codes_of(frames: list[Frame]) -> dict[str, int]:
    found: dict[str, int] = {}
    for frame in frames:
        for damage in frame.damage:
            found[damage.code] = found.get(damage.code, 0) + damage.count
    return found


def seconds(frames: list[Frame]) -> list[float]:
    return [frame.t_ns / 1e9 for frame in frames]


def test_a_folder_gives_a_frame_for_each_image_in_the_order_of_numbers(tmp_path: Path) -> None:
    path = folder(tmp_path / "f", {f"{k}.png": png(colour=(k, k, k)) for k in (2, 9, 10, 101)})
    frames = frames_of(path)
    assert seconds(frames) == [2.0, 9.0, 10.0, 101.0]
    pictures = [frame.scan.picture for frame in frames]
    assert [p.strength[20, 20] for p in pictures if p is not None] == [2, 9, 10, 101]
    assert sniff(octets_from_file(path, "").head, "x") == "images"


@pytest.mark.parametrize("fmt", ["PNG", "JPEG", "TIFF"])
def test_png_jpeg_and_tiff_are_read(tmp_path: Path, fmt: str) -> None:
    (frame,) = frames_of(folder(tmp_path / "f", {"001.x": png(fmt=fmt)}))
    assert frame.scan.picture is not None
    assert abs(int(frame.scan.picture.strength[20, 20]) - 200) <= 2


def test_a_folder_and_its_zip_are_the_same_octets_whatever_the_order_in_the_zip(tmp_path: Path) -> None:
    files = {f"{k}.png": png(colour=(k, k, k)) for k in (11, 2, 30)} | {
        "notes.txt": b"hello",
        "t.csv": b"name,time_s\n",
    }
    one = whole(octets_from_file(folder(tmp_path / "f", files), ""))
    for how in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2):
        two = whole(octets_from_file(zipped(tmp_path / f"{how}.zip", dict(reversed(files.items())), how=how), ""))
        assert one == two
    with tarfile.open(fileobj=io.BytesIO(one)) as tar:
        assert tar.getnames() == ["t.csv", "2.png", "11.png", "30.png", "notes.txt"]


def test_frames_carry_the_octets_they_were_made_of(tmp_path: Path) -> None:
    path = folder(tmp_path / "f", {f"{k:03d}.png": png() for k in range(30)})
    octets = octets_from_file(path, "/input/images")
    frames = frames_of(path)
    again = b"".join(data for frame in frames for _, data in frame.inputs)
    assert again == whole(octets)
    replayed = ImageSource(octets_from_bytes(again, name="x", channel="/input/images"), InputConfig(), PLAIN).frames()
    assert [f.t_ns for f in replayed] == [f.t_ns for f in frames]


def test_a_tar_of_a_folder_is_read_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "f.tar"
    with tarfile.open(path, "w") as tar:
        tar.add(folder(tmp_path / "f", {f"{k}.png": png() for k in (1, 2, 3)}), arcname="f")
    assert sniff(octets_from_file(path, "").head, "x") == "images"
    assert len(frames_of(path)) == 3


@pytest.mark.parametrize(
    ("names", "times", "expected"),
    [
        (("20160112T134512.png", "20160112T134513.500.png"), "auto", [1452606312.0, 1452606313.5]),
        (("r_2016-01-12_13-45-12.png", "r_2016-01-12_13-45-14.png"), "auto", [1452606312.0, 1452606314.0]),
        (("1452606312.png", "1452606313.25.png"), "auto", [1452606312.0, 1452606313.25]),
        (("1452606312250.png", "1452606313000.png"), "auto", [1452606312.25, 1452606313.0]),
        (("radar 7.png", "radar 12.png"), "auto", [7.0, 12.0]),
        (("a.png", "b.png"), "auto", [0.0, 1.0]),
        (("7.png", "12.png"), "rate", [0.0, 1.0]),
    ],
)  # fmt: skip
def test_times_come_from_names(tmp_path: Path, names: tuple[str, ...], times: str, expected: list[float]) -> None:
    images = ImageConfig(centre_px=(20.0, 15.0), pixel_m=10.0, times=times)  # type: ignore[arg-type]
    assert seconds(frames_of(folder(tmp_path / "f", dict.fromkeys(names, png())), images)) == pytest.approx(expected)


def test_steps_count_at_the_rate_on_the_day(tmp_path: Path) -> None:
    images = ImageConfig(centre_px=(20.0, 15.0), pixel_m=10.0, rate_hz=2.0)
    frames = frames_of(folder(tmp_path / "f", {"4.png": png(), "7.png": png()}), images, date="1970-01-02")
    assert seconds(frames) == [86402.0, 86403.5]


def test_times_come_from_a_table_by_name_stem_or_step(tmp_path: Path) -> None:
    table = b"name,time_s\n001.png,100.5\n2,101.25\nimages/third.png,103\n"
    files = {"001.png": png(), "002.png": png(), "third.png": png(), "other.png": png(), "when.csv": table}
    frames = frames_of(folder(tmp_path / "f", files))
    assert seconds(frames) == [100.5, 101.25, 103.0]
    assert codes_of(frames) == {"image-time": 1}


def test_a_table_of_something_else_is_damage_and_nothing_more(tmp_path: Path) -> None:
    files = {"1.png": png(), "ais.csv": b"mmsi,lat,lon\n1,2,3\n", "empty.csv": b"", "bin.csv": bytes(range(256))}
    frames = frames_of(folder(tmp_path / "f", files))
    assert len(frames) == 1 and codes_of(frames) == {"image-table": 3}


def test_a_name_without_a_time_among_others_with_one_is_left_out() -> None:
    clock = Clock(PLAIN)
    assert clock.time_ns("20160112T134512.png") == 1452606312 * 10**9
    assert clock.time_ns("cover.png") is None


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def bomb(width: int, height: int) -> bytes:
    """A PNG that claims to be of this size, with a row or two in it."""
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    )


HOSTILE = {
    "bomb": (bomb(100_000, 100_000), "image-too-large"),
    "larger than numbers": (bomb(2**31 - 1, 2**31 - 1), "image-too-large"),
    "of no pixel": (bomb(0, 30), "image-unreadable"),
    "cut short": (png()[:-40], "image-unreadable"),
    "magic alone": (b"\x89PNG\r\n\x1a\n", "image-unreadable"),
    "a JPEG of noise": (b"\xff\xd8\xff\xe0" + bytes(range(256)) * 4, "image-unreadable"),
    "a TIFF of noise": (b"II*\x00" + bytes(range(256)) * 4, "image-unreadable"),
    "text": (b"no image at all", "no-image"),
    "empty": (b"", "no-image"),
    "another size": (png(width=41), "image-size"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_bad_file_costs_its_own_frame_and_is_counted(tmp_path: Path, name: str) -> None:
    data, code = HOSTILE[name]
    path = folder(tmp_path / "f", {"001.png": png(), "002.png": data, "003.png": png()})
    frames = frames_of(path)
    assert seconds(frames) == [1.0, 3.0]
    assert codes_of(frames) == {code: 1}
    with pytest.raises(InputError, match=code):
        list(ImageSource(octets_from_file(path, ""), InputConfig(), PLAIN, strict=True).frames())


def test_every_cut_and_every_flip_of_an_image_is_read_or_counted() -> None:
    rng = np.random.default_rng(0)
    for fmt in ("PNG", "JPEG", "TIFF"):
        good = png(width=16, height=9, fmt=fmt)
        bad = [good[:n] for n in range(0, len(good), max(1, len(good) // 60))]
        for _ in range(150):
            flipped = bytearray(good)
            for at in rng.integers(0, min(len(good), 400), 3):
                flipped[at] = rng.integers(0, 256)
            bad.append(bytes(flipped))
        for data in bad:
            try:
                pixels = decode(data, max_pixels=10_000)
            except LeftOut as error:
                assert error.code.startswith("image-")
            else:
                assert pixels.dtype == np.uint8 and pixels.shape[0] * pixels.shape[1] <= 10_000


def test_a_file_that_is_too_large_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pack, "MOST_OCTETS", 5000)
    files = {"001.png": png(), "002.png": png() + bytes(6000)}
    for path in (folder(tmp_path / "f", files), zipped(tmp_path / "f.zip", files)):
        frames = frames_of(path)
        assert len(frames) == 1 and codes_of(frames) == {"image-too-large": 1}


def test_a_zip_bomb_ends_where_it_has_unpacked_too_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {f"{k:03d}.png": png() + bytes(100_000) for k in range(40)}
    monkeypatch.setattr(pack, "MOST_UNPACKED", 400_000)
    monkeypatch.setattr(pack, "MOST_RATIO", 1)
    frames = frames_of(zipped(tmp_path / "f.zip", files))
    assert 3 <= len(frames) <= 5
    assert codes_of(frames) == {"zip-bomb": 40 - len(frames)}


def test_a_large_file_is_read_in_small_pieces_without_copying_its_rest_for_each() -> None:
    class Watched(bytes):
        copied = 0

        def __getitem__(self, key: object) -> bytes:  # type: ignore[override]
            part = Watched(bytes(self)[key])  # type: ignore[index]
            Watched.copied += len(part)
            return part

    data = bytes(range(256)) * 400
    stream = pack.ChunkFile(iter([Watched(data), b"", b"end"]))
    pieces = [stream.read(100) for _ in range(1000)]
    assert b"".join(pieces) == data[:100_000] and Watched.copied <= len(data)
    assert stream.read() == data[100_000:] + b"end" and stream.taken() == data + b"end"


def test_a_zip_with_a_vast_directory_is_refused(tmp_path: Path) -> None:
    path = zipped(tmp_path / "f.zip", {"1.png": png()})
    data = bytearray(path.read_bytes())
    at = data.rfind(b"PK\x05\x06")
    data[at + 12 : at + 16] = struct.pack("<I", 1 << 30)
    path.write_bytes(data)
    with pytest.raises(InputError, match="directory of 1073741824 octets"):
        octets_from_file(path, "")


def test_unreadable_members_of_a_zip_cost_their_own_frames(tmp_path: Path) -> None:
    path = zipped(tmp_path / "f.zip", {f"{k:03d}.png": png(colour=(k, 9, 9)) for k in range(1, 5)})
    data = bytearray(path.read_bytes())
    at = data.find(b"002.png") + 30
    data[at : at + 20] = bytes(20)
    path.write_bytes(data)
    frames = frames_of(path)
    assert seconds(frames) == [1.0, 3.0, 4.0] and codes_of(frames) == {"image-unreadable": 1}


@pytest.mark.parametrize("keep", [4, 60, 200, 400])
def test_a_zip_that_breaks_off_is_an_error_with_its_name(tmp_path: Path, keep: int) -> None:
    path = zipped(tmp_path / "f.zip", {f"{k:03d}.png": png() for k in range(5)})
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(InputError, match="can't be read"):
        octets_from_file(path, "")


def test_a_stream_that_breaks_off_keeps_the_frames_before(tmp_path: Path) -> None:
    data = whole(octets_from_file(folder(tmp_path / "f", {f"{k:03d}.png": png() for k in range(9)}), ""))
    for keep in (len(data) // 2, len(data) // 2 + 300, 3000):
        cut = octets_from_bytes(data[:keep], name="x", channel="c")
        frames = list(ImageSource(cut, InputConfig(), PLAIN).frames())
        assert 1 <= len(frames) < 9
        assert set(codes_of(frames)) <= {"images-broken"}


def test_a_folder_without_images_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a folder without images"):
        octets_from_file(folder(tmp_path / "f", {"a.txt": b"x"}), "")


def test_memory_does_not_grow_with_the_number_of_images(tmp_path: Path) -> None:
    import tracemalloc

    peaks = []
    for n in (20, 120):
        path = folder(tmp_path / str(n), {f"{k:03d}.png": png(width=200, height=200) for k in range(n)})
        tracemalloc.start()
        for _ in ImageSource(octets_from_file(path, ""), InputConfig(), PLAIN).frames():
            pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < peaks[0] + 200_000


def test_where_the_radar_is_in_the_images_must_be_told(tmp_path: Path) -> None:
    path = folder(tmp_path / "f", {"1.png": png()})
    for images in (ImageConfig(), ImageConfig(centre_px=(1.0, 1.0)), ImageConfig(pixel_m=3.0)):
        with pytest.raises(ConfigError, match="is not told") as caught:
            frames_of(path, images)
        assert "inspect-images" in caught.value.hint


def test_images_with_the_bow_up_are_turned_by_the_heading(tmp_path: Path) -> None:
    octets = octets_from_file(folder(tmp_path / "f", {"1.png": png()}), "")
    config = InputConfig(stabilised="head", azimuth_offset_deg=3.0)
    pose = PoseTrack.fixed((5.0, 6.0), heading_rad=1.0)
    (frame,) = ImageSource(octets, config, PLAIN, pose=pose).frames()
    assert frame.scan.picture is not None
    assert frame.scan.picture.up_rad == pytest.approx(1.0 + math.radians(3.0))
    assert frame.scan.position_m.tolist() == [5.0, 6.0]
    with pytest.raises(InputError, match="no heading"):
        list(ImageSource(octets, config, PLAIN).frames())


def mask_at(config: ImageConfig, *points: tuple[int, int]) -> list[bool]:
    mask = picture_mask(config, 100, 80)
    return [bool(mask[y, x]) for x, y in points]


def test_the_mask_leaves_the_picture_without_its_interface() -> None:
    base: dict[str, object] = {"centre_px": (50.0, 40.0), "pixel_m": 1.0}
    make = lambda **more: ImageConfig(**(base | more))  # type: ignore[arg-type] # noqa: E731
    assert mask_at(make(radius_px=20.0), (50, 40), (70, 40), (71, 40), (0, 0)) == [True, True, False, False]
    assert mask_at(make(inner_px=5.0), (50, 40), (54, 40), (55, 40)) == [False, False, True]
    assert mask_at(make(annuli_px=((9.0, 11.0),)), (58, 40), (60, 40), (62, 40)) == [True, False, True]
    panel = make(polygons_px=((10.0, 10.0, 30.0, 10.0, 30.0, 20.0, 10.0, 20.0),))
    assert mask_at(panel, (9, 15), (20, 15), (31, 15)) == [True, False, True]
    line = make(lines_deg=(90.0,), line_width_px=3.0)
    assert mask_at(line, (70, 40), (70, 41), (70, 42), (30, 40)) == [False, False, True, True]
    up_and_right = make(lines_deg=(45.0,))
    assert mask_at(up_and_right, (65, 25), (65, 55), (35, 25), (35, 55)) == [False, True, True, True]
    assert reach_px(make(), 100, 80) == pytest.approx(math.hypot(50, 40))
    assert reach_px(make(radius_px=20.0), 100, 80) == 20.0


def coloured(*colours: tuple[int, int, int]) -> NDArray[np.uint8]:
    return np.array([[(*colour, 255) for colour in colours]], np.uint8)


def test_strength_is_grey_a_channel_or_nearness_to_named_colours() -> None:
    pixels = coloured((255, 255, 255), (200, 100, 50), (0, 0, 0))
    grey = Palette(ImageConfig(palette="grey")).strength(pixels)[0].tolist()
    assert grey == [255, round(0.299 * 200 + 0.587 * 100 + 0.114 * 50), 0]
    assert Palette(ImageConfig(palette="green")).strength(pixels)[0].tolist() == [255, 100, 0]
    named = ImageConfig(palette="colours", colours=("#ffff00", "#804000=0.5"), colour_distance=50.0)
    got = Palette(named).strength(coloured((255, 255, 0), (225, 255, 0), (128, 64, 0), (255, 255, 255)))[0].tolist()
    assert got == [255, round(255 * 0.4), 128, 0]
    quiet = ImageConfig(palette="red", interface=("#ff0000",), interface_distance=10.0)
    assert Palette(quiet).strength(coloured((255, 0, 0), (250, 5, 0), (240, 40, 40)))[0].tolist() == [0, 0, 240]


def test_a_colour_seen_before_has_its_strength_still() -> None:
    palette = Palette(ImageConfig(palette="colours", colours=("#ff8000",)))
    rng = np.random.default_rng(0)
    pixels = rng.integers(0, 256, (20, 30, 4)).astype(np.uint8)
    assert np.array_equal(palette.strength(pixels), palette.strength(pixels))
    assert np.array_equal(Palette(palette.config).strength(pixels[::-1])[::-1], palette.strength(pixels))


def test_grey_and_deep_images_are_read() -> None:
    out = io.BytesIO()
    Image.fromarray(np.full((5, 6), 32768 + 128, np.uint16)).save(out, "PNG")
    assert np.unique(decode(out.getvalue(), max_pixels=100)).tolist() == [128]
    out = io.BytesIO()
    Image.fromarray(np.full((5, 6), 77, np.uint8)).save(out, "PNG")
    assert np.unique(decode(out.getvalue(), max_pixels=100)).tolist() == [77]


@pytest.mark.parametrize(
    "wrong",
    [{"centre_px": (1.0,)}, {"pixel_m": -1.0}, {"colours": ("red",)}, {"colours": ("#ff0000=2",)},
     {"palette": "colours"}, {"annuli_px": ((3.0, 2.0),)}, {"polygons_px": ((1.0, 2.0, 3.0),)},
     {"sigmas_px": (0.0,)}, {"blob_min_m": 10.0, "blob_max_m": 5.0}, {"threshold": 1.5}, {"rate_hz": 0.0}],
)  # fmt: skip
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="images"):
        ImageConfig(**wrong)  # type: ignore[arg-type]
