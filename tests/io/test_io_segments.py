"""Segment reflectors in scene files."""

from __future__ import annotations

import pytest

from nlosctl.contract.scene import Scene, SegmentReflector
from nlosctl.errors import DataError
from nlosctl.io.scenes.scene_file import scene_from_toml, scene_to_toml


def test_segments_are_read_and_written_alike() -> None:
    """A wall has ``from`` and ``to``, and is unchanged after writing and reading."""
    scene = Scene(reflectors=(SegmentReflector(name="screen", start=(0.0, 1.5), end=(4.0, -2.0)),))
    text = scene_to_toml(scene)
    assert "from" in text
    assert scene_from_toml(text, "a.toml") == scene


@pytest.mark.parametrize(
    ("line", "words"),
    [("from = [1.0, 2.0]\nto = [1.0, 2.0]", "length"), ("from = [1.0, 2.0]", "to"), ("point = [0.0, 0.0]", "point")],
)
def test_bad_segments_are_refused(line: str, words: str) -> None:
    """A wall without length, without an end, or with the keys of a line is refused with its name."""
    text = f'[[reflector]]\nname = "w"\nkind = "segment"\n{line}\n'
    with pytest.raises(DataError) as caught:
        scene_from_toml(text, "b.toml")
    assert "reflector[0]" in str(caught.value)
    assert words in str(caught.value)
