"""Files as octets, and errors of one line where there is no such file."""

from __future__ import annotations

import os
import threading

import pytest

from maritrack.errors import InputError
from maritrack.io.octets import CHUNK, HEAD, octets_from_bytes, octets_from_file, whole


def test_the_pieces_of_a_file_are_the_file_each_time_they_are_read(tmp_path):
    data = os.urandom(1) * (CHUNK + 5)
    path = tmp_path / "rec"
    path.write_bytes(data)
    octets = octets_from_file(path, "/input/x")
    assert [len(chunk) for chunk in octets.chunks] == [CHUNK, 5]
    assert whole(octets) == whole(octets) == data
    assert (octets.head, octets.size, octets.channel) == (data[:HEAD], len(data), "/input/x")


def test_an_empty_file_has_no_pieces(tmp_path):
    (tmp_path / "rec").touch()
    octets = octets_from_file(tmp_path / "rec", "")
    assert (list(octets.chunks), octets.head, octets.size) == ([], b"", 0)


def test_a_pipe_is_read_once_from_its_beginning(tmp_path):
    pipe, data = tmp_path / "pipe", b"0123456789" * 20_000
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(data,))
    writer.start()
    octets = octets_from_file(pipe, "")
    assert whole(octets) == data
    writer.join()
    assert octets.size == -1


@pytest.mark.parametrize("name", ["missing", "folder", "nul\0"])
def test_what_can_not_be_read_is_an_error_of_one_line(tmp_path, name):
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError) as caught:
        octets_from_file(tmp_path / name, "")
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


def test_a_file_that_vanishes_is_an_error_of_one_line(tmp_path):
    path = tmp_path / "rec"
    path.write_bytes(b"x")
    octets = octets_from_file(path, "")
    path.unlink()
    with pytest.raises(InputError, match="rec: no such file"):
        whole(octets)


def test_octets_in_memory_are_a_single_piece():
    assert whole(octets_from_bytes(b"abc", name="x", channel="")) == b"abc"
    assert list(octets_from_bytes(b"", name="x", channel="").chunks) == []
