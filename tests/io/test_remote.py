"""Inputs by URL: what is there, what matches, what is read."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from maritrack.errors import InputError, UsageError
from maritrack.io import remote

fsspec = pytest.importorskip("fsspec")
OCTETS = bytes(range(256)) * 400


@pytest.fixture
def places(tmp_path: Path) -> list[str]:
    """URLs of a folder with a.bin and b.bin, in two stores."""
    for name in ("a.bin", "b.bin"):
        (tmp_path / name).write_bytes(OCTETS)
        with fsspec.open(f"memory://{tmp_path.name}/{name}", "wb") as file:
            file.write(OCTETS)
    return [f"file://{tmp_path}", f"memory://{tmp_path.name}"]


def test_what_matches_a_pattern_can_be_read(places: list[str]) -> None:
    for place in places:
        names = remote.matching(f"{place}/*.bin")
        assert names == [f"{place}/a.bin", f"{place}/b.bin"]
        assert [remote.read_url(name) for name in names] == [OCTETS, OCTETS]
        assert remote.matching(f"{place}/*.none") == []


def test_octets_have_their_head_size_and_a_place_to_begin(places: list[str]) -> None:
    for place in places:
        found = remote.octets_from_url(f"{place}/a.bin", "/input/x")
        assert (found.size, found.head, found.channel) == (len(OCTETS), OCTETS[: remote.HEAD], "/input/x")
        assert b"".join(found.chunks) == OCTETS
        assert b"".join(remote.UrlChunks(f"{place}/a.bin", 1000)) == OCTETS[1000:]


def test_a_store_within_a_file_stays_open_while_it_is_read(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "z.zip", "w") as file:
        file.writestr("in/a.bin", OCTETS)
    assert remote.read_url(f"zip://in/a.bin::file://{tmp_path}/z.zip") == OCTETS


def test_what_is_not_there_is_told_with_its_url(places: list[str]) -> None:
    for place in places:
        url = f"{place}/none.bin"
        assert not remote.exists(url) and remote.exists(f"{place}/a.bin")
        for ask in (remote.read_url, remote.size_of, remote.token_of, lambda url: remote.octets_from_url(url, "")):
            with pytest.raises(InputError, match=f"^{url}: no such object$"):
                ask(url)
    with pytest.raises(UsageError, match="nix://b/x: Protocol not known"):
        remote.exists("nix://b/x")


def test_a_token_changes_with_the_object(places: list[str]) -> None:
    for place in places:
        before = remote.token_of(f"{place}/a.bin")
        assert remote.token_of(f"{place}/a.bin") == before
        with fsspec.open(f"{place}/a.bin", "wb") as file:
            file.write(OCTETS[1:])
        assert remote.token_of(f"{place}/a.bin") != before
