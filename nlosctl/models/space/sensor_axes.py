"""The axes in which sensors see: a turn of the frame, and a reflection in rows that a mirror unfolds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.space.measured_angles import Vector

__all__ = ["SensorAxes"]


@dataclass(frozen=True)
class SensorAxes(RowBlock):
    """Orthogonal matrices (B, K), given by their rows, from unfolded vectors in the frame to what the sensors see."""

    rows: tuple[Vector, Vector, Vector]

    def seen(self, vector: Vector, at: slice) -> Vector:
        """Return vectors in the frame, of the measurements ``at``, as the sensors see them."""
        x, y, z = (
            row[0][:, at] * vector[0] + row[1][:, at] * vector[1] + row[2][:, at] * vector[2] for row in self.rows
        )
        return x, y, z

    def unfolded(self, vector: tuple[FloatArray, ...], at: slice) -> Vector:
        """Return vectors that sensors see as vectors in the frame: the inverse of `seen`; z may lack, it is 0 then."""
        x, y, z = (
            reduce(np.add, [row[axis][:, at] * part for row, part in zip(self.rows, vector, strict=False)])
            for axis in range(3)
        )
        return x, y, z

    def unfolded_matrix(self, matrix: SymmetricMatrix, at: slice) -> SymmetricMatrix:
        """Return second derivatives (B, C) by what sensors see as those by the unfolded vectors of the rows ``at``."""
        rows = [tuple(part[:, at] for part in row) for row in self.rows]
        total = SymmetricMatrix.full(matrix.xx.shape, 0.0, 3)
        for i in range(3):
            total += SymmetricMatrix.outer(*rows[i], weight=matrix.entry(i, i))
            for j in range(i):
                total += SymmetricMatrix.symmetrized(rows[i], rows[j]) * matrix.entry(i, j)
        return total
