"""What differs between two runs as JUnit XML, which shows in the reviews of GitHub, GitLab and Jenkins.

A test case for each metric and each count, and for each part of the frames of archives; one that differs fails with its
first difference. No times: equal comparisons give equal octets.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import Any

from maritrack.diff import Diff, Difference

NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # characters that XML can't hold


def junit_octets(found: Diff, *, a: str, b: str) -> bytes:
    """The comparison of `a` (expected) with `b` as the octets of a JUnit file."""
    suite = ET.Element(
        "testsuite", name=_text(f"{a} and {b}"), tests=str(len(found.parts)), errors="0", skipped="0",
        failures=str(sum(bool(part.n) for part in found.parts.values())),
    )  # fmt: skip
    for name, part in found.parts.items():
        group, _, own = name.partition(".")
        case = ET.SubElement(suite, "testcase", classname=f"maritrack.{group}", name=_text(own or "frames"))
        if part.first is not None:
            more = f", and {part.n - 1} more" if part.n > 1 else ""
            failure = ET.SubElement(case, "failure", type="difference", message=_text(_line(part.first) + more))
            failure.text = _text(f"{a}: {part.first.a!r}\n{b}: {part.first.b!r}\n")
    root = ET.Element("testsuites", tests=suite.get("tests", ""), failures=suite.get("failures", ""))
    root.append(suite)
    ET.indent(root)
    octets: Any = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return bytes(octets) + b"\n"


def _line(d: Difference) -> str:
    where = f"{d.where} {d.what}" if d.k < 0 else f"scan {d.k}, {d.where} {d.what}"
    return f"{where}: {_short(d.a)} became {_short(d.b)}"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _text(text: str) -> str:
    return NO_XML.sub("?", text)
