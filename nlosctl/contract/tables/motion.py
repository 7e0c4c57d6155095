"""The columns of moving sources: velocities of estimates, parts of tracks, and what a path through fixes needs."""

from __future__ import annotations

from collections.abc import Collection

from nlosctl.contract.tables.columns import Column, Table

__all__ = ["FIXES", "OF_MOVING", "PART", "TRACK", "VELOCITY", "has_states"]

_WORDS = {"x": "to x", "y": "to y", "z": "up, in three dimensions"}

VELOCITY = (
    *(
        Column(
            name=f"v{axis}_m_s",
            type="number",
            unit="m/s",
            nullable=True,
            of_space=axis == "z",
            meaning=f"estimated velocity {_WORDS[axis]}; null where it is not known",
        )
        for axis in "xyz"
    ),
    *(
        Column(
            name=f"cov_v{one}v{other}_m2_s2",
            type="number",
            unit="m2/s2",
            nullable=True,
            of_space="z" in (one, other),
            meaning=f"covariance of the velocity error{', in three dimensions' if 'z' in (one, other) else ''}",
        )
        for one, other in ("xx", "xy", "yy", "xz", "yz", "zz")
    ),
)
"""Velocities and their covariances, those of three dimensions last of each."""

OF_MOVING = ("time_s", *(column.name for column in VELOCITY))
"""The columns of estimates of sources that move within a snapshot: a method that fills them gets the times of rows."""


def has_states(names: Collection[str]) -> bool:
    """Return whether estimates with the columns ``names`` are states of tracks, which have a covariance kind."""
    return {"time_s", "vx_m_s", "covariance_kind"} <= set(names)


PART = Column(
    name="part",
    type="integer",
    nullable=True,
    meaning="number of the track among those that gaps split, from 0 in order of time",
)

TRACK = Column(
    name="track",
    type="integer",
    nullable=True,
    meaning="number of the track that a target is assigned to, from 0 in order of time; null without a position",
)

FIXES = Table(
    name="fixes",
    title="Fixes: positions with covariances at times, through which paths lead",
    columns=(
        Column(name="snapshot", type="identifier", meaning="default: the number of the row"),
        Column(name="method", type="text", nullable=True, meaning="name of the method"),
        Column(name="target", type="integer", nullable=True, meaning="number of the target"),
        Column(name="alternative", type="integer", nullable=True, meaning="rank of the alternative, 0 is the first"),
        Column(name="x_m", type="number", unit="m", required=True, nullable=True, meaning="position"),
        Column(name="y_m", type="number", unit="m", required=True, nullable=True, meaning="position"),
        Column(name="z_m", type="number", unit="m", nullable=True, of_space=True, meaning="height"),
        *(
            Column(
                name=f"cov_{axes}_m2",
                type="number",
                unit="m2",
                required="z" not in axes,
                nullable=True,
                of_space="z" in axes,
                meaning="covariance of the position error",
            )
            for axes in ("xx", "xy", "yy", "xz", "yz", "zz")
        ),
        Column(name="status", type="text", nullable=True, meaning="outcome, one of the status words"),
        Column(name="time_s", type="number", unit="s", nullable=True, meaning="time"),
        Column(name="time", type="text", nullable=True, meaning="time, ISO 8601, in place of time_s"),
        Column(name="frame", type="text", nullable=True, meaning="local plane on earth"),
    ),
)
"""What `nlosctl track` reads in place of measurements."""
