"""The columns of estimates that the settings ``ellipse`` and ``add`` ask for."""

from __future__ import annotations

from nlosctl.contract.tables.columns import Column

__all__ = ["ADDED_COLUMNS", "ELLIPSE"]

ELLIPSE = (
    Column(
        name="semi_major_m",
        type="number",
        unit="m",
        nullable=True,
        meaning="major semi-axis of the ellipse that contains ellipse_probability of Gaussian errors, or, with "
        "std_dof, of errors of an estimated standard deviation",
    ),
    Column(name="semi_minor_m", type="number", unit="m", nullable=True, meaning="minor semi-axis of the ellipse"),
    Column(
        name="orientation_rad",
        type="number",
        unit="rad",
        nullable=True,
        meaning="direction of the major axis, counter-clockwise from +x",
    ),
    Column(
        name="half_height_m",
        type="number",
        unit="m",
        nullable=True,
        of_space=True,
        meaning="half of the interval about z that contains ellipse_probability of the errors of the height",
    ),
    Column(name="ellipse_probability", type="number", nullable=True, meaning="probability of the ellipse"),
)
"""The columns of estimates that the setting ``ellipse`` asks for."""

_ADDED = (
    Column(
        name="cep50_m",
        type="number",
        unit="m",
        nullable=True,
        add="cep50",
        meaning="circular error probable: radius of the circle about x, y that contains half of Gaussian errors",
    ),
    Column(
        name="sep50_m",
        type="number",
        unit="m",
        nullable=True,
        add="sep50",
        of_space=True,
        meaning="spherical error probable: radius of the sphere about the position with half of Gaussian errors",
    ),
    Column(
        name="gdop",
        type="number",
        nullable=True,
        add="gdop",
        meaning="geometric dilution of precision: root of the trace of the covariance if every used row had a line or "
        "circle of position with a standard deviation of 1 m",
    ),
    *(
        Column(
            name=name,
            type="number",
            nullable=True,
            add=name,
            of_space=True,
            meaning=f"{part} part of gdop, in three dimensions",
        )
        for name, part in (("hdop", "horizontal"), ("vdop", "vertical"))
    ),
    Column(
        name="nees",
        type="number",
        nullable=True,
        add="nees",
        meaning="normalized estimation error squared e' C^-1 e, from the error e of x, y (the input needs truth_x_m "
        "and truth_y_m, in three dimensions truth_z_m too) and the covariance C; mean 2 (in three dimensions 3) if "
        "covariances are correct; null without a truth or a covariance",
    ),
)

ADDED_COLUMNS = {column.add: column for column in _ADDED}
"""The columns of estimates that the setting ``add`` requests, by its names."""
