"""What an input is, by its content and never by its name."""

from __future__ import annotations

import re

from maritrack.errors import InputError
from maritrack.io.containers.kinds import GZIP, MCAP_MAGIC, RAW, container_of, is_gzip_of_nothing, unpacked_head
from maritrack.io.images.pack import SIDE_NAMES, first_member

CAT240 = 0xF0
MAGIC = (  # first octets, what they are, what to do
    (b"\x89PNG", "a PNG image", "name the folder of the images"),
    (b"\xff\xd8\xff", "a JPEG image", "name the folder of the images"),
    (b"II*\x00", "a TIFF image", "name the folder of the images"),
    (b"MM\x00*", "a TIFF image", "name the folder of the images"),
    (b"PK\x03\x04", "a ZIP archive", "a ZIP of images is read from a file, not from a pipe"),
    (b"\x28\xb5\x2f\xfd", "compressed with Zstandard", "unpack it first"),
    (b"RRF", "a Rerun recording", "it is a picture of a run, the record is the .mcap"),
    (b"\x89HDF", "an HDF5 file", "of MATLAB files, version 5 is read"),
    (b"MATLAB 7.3", "a MATLAB 7.3 file", "save it with -v7"),
    (b"\xff\xfe", "UTF-16 text", "save it as UTF-8"),
    (b"\xfe\xff", "UTF-16 text", "save it as UTF-8"),
)
ARCHIVE = b"maritrack.archive"  # stands in the head of an archive of a run
READ = (
    "CAT240 radar video (as blocks, pcap, pcapng, FINAL or MCAP, also gzipped), folders and ZIPs of radar images, "
    "points as JSON, Autoferry, plots as CSV and AIS (NMEA sentences, CSV, .mat) are read"
)
AIS = re.compile(rb"!(?:[A-Z]{2}|--)VD[MO],\d,\d,")  # a sentence of AIS
OWN_SHIP = re.compile(r"(?:\\[^\\\r\n]*\\)?\$[A-Z]{2}[A-Z]{3},")  # a sentence of an instrument, maybe behind a tag
LAT = {"lat", "latitude", "lat_deg", "latitude_deg", "latitude_degrees"}


def sniff(head: bytes, name: str) -> str:
    """The kind of an input from its first octets (64 KiB are enough).

    "cat240", "points", "autoferry", "autoferry-truth", "plots", "images", "rwmr", "ais" or "nmea". InputError
    says what else it is, as far as that can be told.
    """
    if not head:
        raise InputError(f"{name}: empty")
    if head.startswith(GZIP):
        return _behind_gzip(head, name)
    if head.startswith(MCAP_MAGIC) and ARCHIVE in head:
        raise InputError(f"{name}: an archive of a run", hint="maritrack replay runs it again, convert gives its input")
    if files := first_member(head):
        return _kind_of_files(files, name)
    refuse_known(head, name)
    if head.startswith(b"MATLAB 5.0 MAT-file"):
        return "autoferry"
    if container_of(head) != RAW:
        return "cat240"
    kind = _text_kind(head, name)
    if kind:
        return kind
    if _has_cat240(head):
        return "cat240"
    if head[0] and [head[at] for at in _blocks(head, 0)[:4] if at < len(head)] == [head[0]] * 4:
        raise InputError(f"{name}: ASTERIX category {head[0]:03d}, no radar video", hint="category 240 is read")
    raise InputError(f"{name}: not a recording that is known", hint=READ)


def _kind_of_files(first: str, name: str) -> str:
    """Kind of a TAR by the name of its first file."""
    lower = first.lower().rpartition("/")[2]
    if lower in SIDE_NAMES:
        return "rwmr"
    if lower.endswith((".png", ".jpg", ".jpeg", ".tif", ".tiff", ".csv")):
        return "images"
    raise InputError(f"{name}: a folder or an archive of files that begins with {first}", hint=READ)


def refuse_known(head: bytes, name: str) -> None:
    """InputError where the first octets are those of a known kind of file that isn't read."""
    for magic, what, hint in MAGIC:
        if head.startswith(magic):
            raise InputError(f"{name}: {what}", hint=hint)


def _behind_gzip(head: bytes, name: str) -> str:
    """Kind of what is compressed."""
    unpacked = unpacked_head(head)
    if not unpacked and is_gzip_of_nothing(head):
        raise InputError(f"{name}: empty, compressed with gzip")
    if not unpacked:
        raise InputError(f"{name}: compressed with gzip, but it can't be unpacked")
    kind = sniff(unpacked, name) if not unpacked.startswith(GZIP) else "gzip"
    if kind != "cat240":
        raise InputError(f"{name}: compressed with gzip ({kind})", hint="unpack it first; of CAT240 gzip is read")
    return kind


def _text_kind(head: bytes, name: str) -> str:
    """Kind of a text, "" for what is none."""
    if AIS.search(head):
        return "ais"
    text = head.decode("utf-8-sig", "replace").lstrip()
    if text[:1] == "{":
        return _object_kind(text, name)
    if text[:1] == "[" and re.match(r"\[\s*[\[{\]]", text):
        return _list_kind(text, name)
    if b"\x00" in head[:1024]:
        return ""
    if OWN_SHIP.match(text):
        return "nmea"
    return _table_kind(text)


def _list_kind(text: str, name: str) -> str:
    """Kind of a JSON list."""
    for word, kind in (('"sensorID"', "autoferry"), ('"targetID"', "autoferry-truth")):
        if word in text:
            return kind
    raise InputError(f"{name}: a JSON list, but not of Autoferry", hint=READ)


def _object_kind(text: str, name: str) -> str:
    """Kind of a JSON object; what begins with '{' by chance is left to the other readings."""
    if re.search(r'"format"\s*:\s*"maritrack-points/', text) or re.search(r'"scans"\s*:\s*\[', text):
        return "points"
    if '"FeatureCollection"' in text:
        raise InputError(f"{name}: GeoJSON, not a recording", hint=READ)
    if re.match(r'\{\s*("|\})', text):
        raise InputError(f'{name}: JSON without "format": "maritrack-points/1"', hint=READ)
    return ""


def _table_kind(text: str) -> str:
    """Plots or AIS by the names of columns, "" for what is no such table."""
    from maritrack.io.csvtable import first_line, separator_of, simple_name

    line = first_line(text)
    columns = {simple_name(cell) for cell in line.split(separator_of(line))}
    words = {column.split("_")[0] for column in columns}
    if words & {"azimuth", "bearing"} and "range" in words:
        return "plots"
    return "ais" if columns & LAT else ""


def _has_cat240(head: bytes) -> bool:
    """Whether there is a CAT240 block at the beginning, behind blocks of other categories, or behind damage."""
    chain = _blocks(head, 0)
    if _is_cat240(head, 0) or (head[0] == CAT240 and len(chain) > 2) or any(_is_cat240(head, at) for at in chain):
        return True
    for found in re.finditer(b"\xf0", head):
        at = found.start()
        if _like_record(head, at):
            after = _blocks(head, at)[1:]
            if len(after) > 5 or after[:1] == [len(head)] or (after and _is_cat240(head, after[0])):
                return True
    return False


def _is_cat240(head: bytes, at: int) -> bool:
    return at < len(head) and head[at] == CAT240 and _like_record(head, at)


def _blocks(head: bytes, at: int) -> list[int]:
    """Where data blocks begin that follow each other from here, as far as their lengths fit into the head.

    The end of the head is one of them where the last block ends right there.
    """
    found = [at]
    while at + 3 <= len(head) and head[at] > 0:
        length = int.from_bytes(head[at + 1 : at + 3], "big")
        if length < 4 or at + length > len(head):
            break
        at += length
        found.append(at)
    return found


def _like_record(head: bytes, at: int) -> bool:
    """Whether a block begins with what CAT240 records begin with: source, then message type 1 or 2."""
    if at + 7 > len(head):
        return False
    kind = at + 6 + (head[at + 3] & 1)
    return head[at + 3] & 0xC0 == 0xC0 and kind < len(head) and head[kind] in (1, 2)
