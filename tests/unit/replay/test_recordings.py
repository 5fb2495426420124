"""Readers say which files are theirs; what one does wrong costs only itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import pytest

from tickfix.api import Floor, ReaderError, Recording
from tickfix.registry import Offer, Registry
from tickfix.replay.recording_files import find_recordings, read_recordings


class Texts:
    """Takes every file that ends in .txt."""

    kind: ClassVar[str] = "reader"
    name: ClassVar[str] = "texts"

    def recordings(self, path: Path) -> Sequence[Path]:
        return sorted(p for p in ([path] if path.is_file() else path.rglob("*")) if p.suffix == ".txt")

    def read(self, path: Path) -> Recording:
        if path.stem == "bad":
            raise ReaderError(f"{path}: is bad")
        if path.stem == "worse":
            raise KeyError("column")
        return Recording(name=path.stem, floor="", events=())

    def floor(self, path: Path) -> Floor | None:
        return None


class Everything(Texts):
    """Takes whatever there is."""

    name: ClassVar[str] = "everything"

    def recordings(self, path: Path) -> Sequence[Path]:
        return [path] if path.is_file() else sorted(path.iterdir())


class Broken(Texts):
    """Takes nothing, loudly."""

    name: ClassVar[str] = "broken"

    def recordings(self, path: Path) -> Sequence[Path]:
        raise RuntimeError("oh no")


def registry(*classes: Any, own: Any = None) -> Registry:
    return Registry(Offer("reader", c.name, c, "test", "tickfix" if c is own else "stranger", "1") for c in classes)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("b.txt", "a.txt", "c.csv"):
        (tmp_path / name).write_text("x", encoding="utf-8")
    return tmp_path


def test_a_file_named_twice_is_taken_once_in_the_order_given(folder: Path) -> None:
    found = find_recordings([folder / "b.txt", folder], registry(Texts))
    assert [source.path.name for source in found.sources] == ["b.txt", "a.txt"]


def test_our_own_reader_comes_first_then_the_first_by_name(folder: Path) -> None:
    names = {s.path.name: s.name for s in find_recordings([folder], registry(Texts, Everything, own=Texts)).sources}
    assert names == {"a.txt": "texts", "b.txt": "texts", "c.csv": "everything"}
    assert {s.name for s in find_recordings([folder], registry(Texts, Everything)).sources} == {"everything"}


def test_a_reader_that_fails_is_named_and_the_others_read(folder: Path) -> None:
    found = find_recordings([folder], registry(Broken, Texts))
    assert len(found.sources) == 2
    (problem,) = found.problems
    assert "reader 'broken' failed on" in problem
    assert "RuntimeError: oh no; it is left out" in problem


def test_nothing_there_and_nothing_recognised_are_errors(folder: Path) -> None:
    with pytest.raises(ReaderError, match="no such file or folder"):
        find_recordings([folder / "none"], registry(Texts))
    with pytest.raises(ReaderError, match=r"no recording that a reader recognises \(readers: texts\)"):
        find_recordings([folder / "c.csv"], registry(Texts))


def test_a_recording_that_cannot_be_read_gives_its_error_in_its_place(tmp_path: Path) -> None:
    for name in ("a", "bad", "c", "worse"):
        (tmp_path / f"{name}.txt").write_text("x", encoding="utf-8")
    seen: list[tuple[str, int, int]] = []
    found = find_recordings([tmp_path], registry(Texts))
    a, bad, c, worse = read_recordings(found.sources, lambda *step: seen.append(step), processes=1)
    assert isinstance(a, Recording)
    assert isinstance(c, Recording)
    assert str(bad).endswith("bad.txt: is bad")
    assert "reader 'texts' failed: KeyError: 'column'" in str(worse)
    assert seen == [("reading", done, 4) for done in range(5)]
