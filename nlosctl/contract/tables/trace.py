"""The columns of the steps of sequential methods."""

from __future__ import annotations

from nlosctl.contract.tables.columns import Column, Table

__all__ = ["TRACE"]

TRACE = Table(
    name="trace",
    title="Trace: a row per snapshot and step of a sequential method, the state after each sensor",
    columns=(
        Column(name="snapshot", type="identifier", required=True, meaning="as in the measurements"),
        Column(name="method", type="text", required=True, meaning="name of the method"),
        Column(name="step", type="integer", required=True, meaning="number of measurements used so far"),
        Column(name="sensor", type="identifier", required=True, meaning="sensor of the measurement just used"),
        Column(name="x_m", type="number", unit="m", required=True, meaning="position after this step"),
        Column(name="y_m", type="number", unit="m", required=True, meaning="position after this step"),
        *(
            Column(
                name=f"cov_{axes}_m2",
                type="number",
                unit="m2",
                required=True,
                meaning="covariance of the position after this step",
            )
            for axes in ("xx", "xy", "yy")
        ),
    ),
)
