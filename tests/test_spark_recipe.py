"""The recipe for Spark in docs/large-data.md."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet
import pytest

import nlosctl

pytestmark = pytest.mark.extensive

ROOT = Path(__file__).parents[1]
GOOD = ROOT / "fixtures" / "good_bearings.parquet"
SCENE = ROOT / "fixtures" / "good_bearings.scene.toml"


def recipe() -> Callable[[Iterator[Any]], Iterator[Any]]:
    """Return the function on the page, from its text."""
    text = (ROOT / "docs" / "large-data.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?def solve.*?)\n\n\n", text, re.DOTALL)
    assert code is not None
    names: dict[str, Any] = {}
    exec(code[1].replace('"scene.toml"', repr(str(SCENE))), names)  # noqa: S102 - our own document
    function: Callable[[Iterator[Any]], Iterator[Any]] = names["solve"]
    return function


def test_batches_of_a_partition_give_the_estimates_of_one_run() -> None:
    """For any division of a partition into Arrow batches each snapshot is solved once and whole."""
    table = pyarrow.parquet.read_table(GOOD).replace_schema_metadata(None)
    expected = nlosctl.localize(table, method="ml", scene=SCENE).estimates
    for rows in (7, 100, 1000):
        found = pa.Table.from_batches(list(recipe()(iter(table.to_batches(max_chunksize=rows)))))
        assert found.equals(expected.select(found.column_names))
        assert found.num_rows == 40


def test_empty_partitions_give_no_rows() -> None:
    """Empty partitions, which Spark produces, give no rows."""
    assert list(recipe()(iter([]))) == []
