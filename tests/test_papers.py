"""Every listed equation has one home, every tag is listed, and every home has a test."""

from __future__ import annotations

from pathlib import Path

import pytest

from maritrack import papers
from maritrack.errors import UsageError

HOMES, MARKS = papers.homes(), papers.marks()
OF_DONE = [equation.key for equation in papers.EQUATIONS.values() if equation.paper in papers.DONE]


def test_each_tag_in_the_code_is_listed() -> None:
    assert set(HOMES) <= set(papers.EQUATIONS)
    assert {deviation.key for deviation in papers.deviations()} <= set(papers.EQUATIONS)


def test_each_tag_of_a_test_is_listed() -> None:
    assert set(MARKS) <= set(papers.EQUATIONS)


@pytest.mark.parametrize("key", OF_DONE)
def test_each_equation_has_one_home(key: str) -> None:
    assert [str(place) for place in HOMES.get(key, [])][1:] == [], "more than one"
    assert key in HOMES


@pytest.mark.parametrize("key", OF_DONE)
def test_each_equation_is_shown_by_a_test(key: str) -> None:
    assert key in MARKS


def test_equations_of_a_paper_are_numbered_without_gaps() -> None:
    for paper in papers.DONE:
        numbers = [int(equation.number) for equation in papers.select(paper)]
        assert numbers == list(range(1, len(numbers) + 1))
    assert {equation.paper for equation in papers.EQUATIONS.values()} == set(papers.PAPERS)


def test_all_equations_of_the_polar_paper_are_listed() -> None:
    assert len(papers.select("polar")) == 12
    assert [e.meaning for e in papers.select("polar-12")] == [papers.EQUATIONS["polar-12"].meaning]


def test_an_unknown_paper_is_an_error() -> None:
    with pytest.raises(UsageError, match="polars"):
        papers.select("polars")


def test_tags_are_read_where_they_stand(tmp_path: Path) -> None:
    root = tmp_path / "package"
    root.mkdir()
    text = '''"""A module.   Eq: a-1, a-2"""

class Thing:
    """What it is.

    Eq: b-3.   Deviates: b-3 in two
    lines.

    More.
    """

    def act(self) -> None:
        """First.   Deviates: a-1 by a sign.   Eq: a-4"""
'''
    (root / "module.py").write_text(text)
    homes = papers.homes(root)
    assert {key: [(p.file, p.line, p.name) for p in places] for key, places in homes.items()} == {
        "a-1": [("package/module.py", 1, "")],
        "a-2": [("package/module.py", 1, "")],
        "b-3": [("package/module.py", 6, "Thing")],
        "a-4": [("package/module.py", 13, "Thing.act")],
    }
    told = [(d.key, d.text, d.place.line) for d in papers.deviations(root)]
    assert told == [("b-3", "in two lines.", 6), ("a-1", "by a sign.", 13)]


def test_marks_of_tests_are_read_from_their_decorators(tmp_path: Path) -> None:
    (tmp_path / "package").mkdir()
    (tmp_path / "tests").mkdir()
    text = 'import pytest\n\n@pytest.mark.slow\n@pytest.mark.eq("a-1", "a-2")\ndef test_it() -> None:\n    pass\n'
    (tmp_path / "tests" / "test_it.py").write_text(text)
    assert papers.marks(tmp_path / "package") == {}
    (tmp_path / "pyproject.toml").write_text("")
    assert {key: str(*places) for key, places in papers.marks(tmp_path / "package").items()} == {
        "a-1": "tests/test_it.py:5",
        "a-2": "tests/test_it.py:5",
    }


def test_a_tracker_is_made_of_what_it_imports_and_of_nothing_else() -> None:
    files = papers.files_of_tracker("jipda")
    assert {"maritrack/trackers/jipda.py", "maritrack/objects/giw.py", "maritrack/types.py"} <= files
    assert not {file for file in files if file.startswith(("maritrack/sinks", "maritrack/io", "maritrack/run"))}


def test_imports_are_followed_however_indirect(tmp_path: Path) -> None:
    root = tmp_path / "pack"
    (root / "inner").mkdir(parents=True)
    for name, text in {
        "__init__": "", "a": "from pack import b", "b": "def f():\n    import pack.inner.c", "d": "import pack.a",
        "inner/__init__": "from pack import d", "inner/c": "import os",
    }.items():  # fmt: skip
        (root / f"{name}.py").write_text(text)
    assert papers.imported("pack.a", root) == {"pack/a.py", "pack/b.py", "pack/inner/c.py"}


def test_assumed_numbers_give_preset_key_value_and_reason() -> None:
    rows = {(row.preset, row.key): row for row in papers.assumed()}
    row = rows["autoferry", "input.latency_s"]
    assert float(row.value) > 0 and "trail" in row.reason
