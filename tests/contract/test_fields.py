"""The text of ``--field``."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlosctl.contract.fields import BoxField, CircleField, PolygonField, SensorsField, parse_field
from nlosctl.errors import DataError, UsageError


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("-1,2.5,3,4e3", BoxField(xmin_m=-1.0, xmax_m=2.5, ymin_m=3.0, ymax_m=4000.0)),
        ("circle:1,-2,30", CircleField(x_m=1.0, y_m=-2.0, radius_m=30.0)),
        ("sensors:4", SensorsField(factor=4.0)),
        ("0,1000.0001,0,600", BoxField(xmin_m=0.0, xmax_m=1000.0001, ymin_m=0.0, ymax_m=600.0)),
        ("circle:0.123456789,1e14,3", CircleField(x_m=0.123456789, y_m=1e14, radius_m=3.0)),
        ("polygon:0,0;10,0;10,5.00000001;0,0", PolygonField(vertices_m=((0.0, 0.0), (10.0, 0.0), (10.0, 5.00000001)))),
    ],
)
def test_field_texts_round_trip(text: str, field: object) -> None:
    """Each form of text is parsed to its field, and the field's text to the same field."""
    assert parse_field(text) == field
    assert parse_field(str(field)) == field


@given(st.lists(st.floats(-1e15, 1e15), min_size=3, max_size=3))
def test_the_text_of_a_region_is_exact(numbers: list[float]) -> None:
    """A text of six digits would make different regions equal, and a run could not be repeated."""
    x, y, size = numbers
    region = CircleField(x_m=x, y_m=y, radius_m=abs(size) + 1e-9)
    assert parse_field(str(region)) == region


@pytest.mark.parametrize(
    "text",
    ["", "1,2,3", "1,0,0,1", "0,1,2,2", "a,b,c,d", "circle:0,0,0", "circle:1,2", "sensors:-1", "sensors:x",
     "disc:1,2,3", "nan,1,0,1", "circle:0,0,inf", "polygon:0,0;1,x;2,2", "polygon:0,0;1,1;2"],
)  # fmt: skip
def test_invalid_field_texts_are_usage_errors(text: str) -> None:
    """Text that is not a field, or an empty field, is a usage error."""
    with pytest.raises(UsageError, match="field"):
        parse_field(text)


def test_polygon_is_read_from_its_file(tmp_path: Path) -> None:
    """A polygon file has x,y lines; comments, a header and a repeated first vertex are allowed."""
    file = tmp_path / "yard.csv"
    file.write_text("# yard\nx_m,y_m\n0,0\n10,0  # corner\n\n10,5\n0,0\n")
    assert parse_field(f"polygon:{file}") == PolygonField(vertices_m=((0.0, 0.0), (10.0, 0.0), (10.0, 5.0)))


@pytest.mark.parametrize(
    ("content", "complaint"),
    [("0,0\n1,0\n", "at least 3"), ("0,0\n1,zero\n2,2\n", "line 2"), ("0,0\n1,nan\n2,2\n", "line 2"), (None, "read")],
)
def test_invalid_polygon_files_are_data_errors(tmp_path: Path, content: str | None, complaint: str) -> None:
    """A missing, too short or malformed polygon file is a data error that names the line."""
    file = tmp_path / "yard.csv"
    if content is not None:
        file.write_text(content)
    with pytest.raises(DataError, match=complaint):
        parse_field(f"polygon:{file}")
