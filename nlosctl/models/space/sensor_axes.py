"""The axes in which sensors see: a turn of the frame, and a reflection in rows that a mirror unfolds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.space.measured_angles import Vector

__all__ = ["SensorAxes"]


@dataclass(frozen=True)
class SensorAxes(RowBlock):
    """Orthogonal matrices (B, K), given by their rows, from unfolded vectors in the frame to what the sensors see."""

    rows: tuple[Vector, Vector, Vector]

    def seen(self, vector: Vector, at: Any) -> Vector:
        """Return vectors in the frame as the sensors see them; ``at`` indexes the rows (B, K) to the vectors' shape."""
        x, y, z = (row[0][at] * vector[0] + row[1][at] * vector[1] + row[2][at] * vector[2] for row in self.rows)
        return x, y, z

    def unfolded(self, vector: Vector, at: Any) -> Vector:
        """Return vectors that sensors see as vectors in the frame: the inverse of `seen`."""
        one, two, three = self.rows
        x, y, z = (
            one[axis][at] * vector[0] + two[axis][at] * vector[1] + three[axis][at] * vector[2] for axis in range(3)
        )
        return x, y, z

    def unfolded_matrix(self, matrix: SymmetricMatrix, k: int) -> SymmetricMatrix:
        """Return second derivatives (B,) by what sensors see as those by the unfolded vectors of row ``k``."""
        rows = [tuple(part[:, k] for part in row) for row in self.rows]
        total = SymmetricMatrix.full(matrix.xx.shape, 0.0, 3)
        for i in range(3):
            total += SymmetricMatrix.outer(*rows[i], weight=matrix.entry(i, i))
            for j in range(i):
                total += SymmetricMatrix.symmetrized(rows[i], rows[j]) * matrix.entry(i, j)
        return total
