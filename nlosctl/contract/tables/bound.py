"""The columns of bounds."""

from __future__ import annotations

from nlosctl.contract.tables.columns import Column, Table

__all__ = ["BOUND"]

BOUND = Table(
    name="bound",
    title="Bound: the Cramer-Rao bound of the position, a row per snapshot or per vertex of a map",
    columns=(
        Column(name="snapshot", type="identifier", nullable=True, meaning="as in the measurements; not in a map"),
        Column(name="x_m", type="number", unit="m", required=True, nullable=True, meaning="position of the bound"),
        Column(name="y_m", type="number", unit="m", required=True, nullable=True, meaning="position of the bound"),
        Column(name="z_m", type="number", unit="m", nullable=True, meaning="its height, in three dimensions"),
        *(
            Column(name=name, type="number", unit=unit, required=True, nullable=True, meaning=meaning)
            for name, unit, meaning in (
                ("bound_xx_m2", "m2", "least covariance of an unbiased estimate; null without a bound"),
                ("bound_xy_m2", "m2", "least covariance of an unbiased estimate"),
                ("bound_yy_m2", "m2", "least covariance of an unbiased estimate"),
            )
        ),
        *(
            Column(
                name=f"bound_{axes}_m2",
                type="number",
                unit="m2",
                nullable=True,
                meaning="least covariance of an unbiased estimate, in three dimensions; 0 of a height that is exact",
            )
            for axes in ("xz", "yz", "zz")
        ),
        *(
            Column(name=name, type="number", unit=unit, required=True, nullable=True, meaning=meaning)
            for name, unit, meaning in (
                ("rms_m", "m", "root of the trace: lower bound of the RMSE"),
                ("semi_major_m", "m", "semi-axis of the one-sigma ellipse of x and y"),
                ("semi_minor_m", "m", "semi-axis of the one-sigma ellipse of x and y"),
                ("orientation_rad", "rad", "direction of the major axis, counter-clockwise from +x"),
                ("cep50_m", "m", "circular error probable: radius of the circle that contains half of Gaussian errors"),
            )
        ),
        Column(
            name="n_used", type="integer", required=True, meaning="rows with a free path to the position in this scene"
        ),
        Column(
            name="time_s",
            type="number",
            unit="s",
            nullable=True,
            meaning="mean time of the rows kept in a window, or of a source that moves",
        ),
        *(
            Column(
                name=f"bound_v{one}v{other}_m2_s2",
                type="number",
                unit="m2/s2",
                nullable=True,
                of_space="z" in (one, other),
                meaning="least covariance of an unbiased estimate of the velocity of a source that moves",
            )
            for one, other in ("xx", "xy", "yy", "xz", "yz", "zz")
        ),
    ),
)
