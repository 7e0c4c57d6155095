"""The columns of estimates and flags, and of a table of true positions."""

from __future__ import annotations

from nlosctl.contract.tables.added import ADDED_COLUMNS, ELLIPSE
from nlosctl.contract.tables.arrivals import OFFSET
from nlosctl.contract.tables.columns import Column, Table
from nlosctl.contract.tables.motion import PART, TRACK, VELOCITY
from nlosctl.contract.tables.shared import TRUTH_POSITION
from nlosctl.contract.tables.space import TRUTH_HEIGHT

__all__ = ["ESTIMATES", "FLAGS", "TRUTH"]

ESTIMATES = Table(
    name="estimates",
    title="Estimates: a row per snapshot, method, target and alternative",
    columns=(
        Column(name="snapshot", type="identifier", required=True, meaning="as in the measurements"),
        Column(name="method", type="text", required=True, meaning="name of the method"),
        Column(name="target", type="integer", required=True, meaning="number of the target, from 0"),
        Column(
            name="alternative", type="integer", required=True, meaning="rank of the alternative, from 0, best first"
        ),
        Column(name="x_m", type="number", unit="m", required=True, nullable=True, meaning="estimated position"),
        Column(name="y_m", type="number", unit="m", required=True, nullable=True, meaning="estimated position"),
        Column(name="z_m", type="number", unit="m", nullable=True, meaning="estimated height, in three dimensions"),
        *(
            Column(
                name=f"cov_{axes}_m2",
                type="number",
                unit="m2",
                required="z" not in axes,
                nullable=True,
                meaning=f"covariance of the position error{', in three dimensions' if 'z' in axes else ''}",
            )
            for axes in ("xx", "xy", "yy", "xz", "yz", "zz")
        ),
        *VELOCITY,
        Column(name="n_measurements", type="integer", required=True, meaning="rows of the snapshot"),
        Column(name="n_used", type="integer", required=True, meaning="rows that the estimate uses"),
        Column(
            name="used_share",
            type="number",
            every_run=True,
            meaning="share of the snapshot's rows that the estimate uses: n_used / n_measurements",
        ),
        Column(
            name="cost",
            type="number",
            required=True,
            nullable=True,
            meaning="the method's cost: half the chi-square, or the negative log-likelihood in nats (see methods show)",
        ),
        Column(
            name="fit_p_value",
            type="number",
            nullable=True,
            every_run=True,
            meaning="p-value of the fit: probability that errors of the stated stds leave residuals with a chi-square "
            "at least this large (robust methods: of the inliers); null without spare scalars or a covariance",
        ),
        Column(name="status", type="text", required=True, meaning="outcome, one of the status words"),
        Column(
            name="time_s",
            type="number",
            unit="s",
            nullable=True,
            meaning="mean time of the rows kept in a window, of a state of a track, or of a source that moves",
        ),
        PART,
        TRACK,
        Column(
            name="covariance_kind",
            type="text",
            nullable=True,
            meaning="what the covariance allows for (robust methods): inliers, or posterior: rows used wrongly too; "
            "of a track: smoothed (given all of its rows) or filtered (given those until then)",
        ),
        Column(
            name="existence_probability",
            type="number",
            nullable=True,
            meaning="posterior probability that the target exists near x, y, given the method's model and the other "
            "targets of the estimate",
        ),
        Column(
            name="std_factor",
            type="number",
            nullable=True,
            meaning="estimated factor of the standard deviations (estimate_std): the std itself, in rad or m, where "
            "none is stated; if sensors have factors of their own, that of the size of the covariance",
        ),
        Column(
            name="std_dof",
            type="number",
            nullable=True,
            meaning="degrees of freedom of std_factor: error ellipses are those of the F distribution with it",
        ),
        *OFFSET,
        Column(name="lat_deg", type="number", unit="deg", nullable=True, meaning="latitude of x, y (WGS 84)"),
        Column(name="lon_deg", type="number", unit="deg", nullable=True, meaning="longitude of x, y (WGS 84)"),
        Column(
            name="height_m",
            type="number",
            unit="m",
            nullable=True,
            meaning="height above the ellipsoid (WGS 84) of a place on earth in three dimensions; z_m is the same",
        ),
        Column(
            name="frame",
            type="text",
            nullable=True,
            meaning="local plane on earth: a CRS, or latitude and longitude of the origin, and the rotation if any; "
            "'ellipsoid' after it: z_m is the height, covariances are in local east, north and up",
        ),
        *ELLIPSE,
        *ADDED_COLUMNS.values(),
        *TRUTH_POSITION,
        TRUTH_HEIGHT,
    ),
)

FLAGS = Table(
    name="flags",
    title="Flags: a row per measurement in input order, with the columns of the input",
    columns=(
        Column(name="snapshot", type="identifier", required=True, meaning="as in the measurements"),
        Column(name="method", type="text", nullable=True, meaning="name of the method, if several ran"),
        Column(name="used", type="boolean", required=True, meaning="whether the estimate uses the row"),
        Column(
            name="residual_rad",
            type="number",
            unit="rad",
            nullable=True,
            meaning="bearing, measured minus predicted at the estimate",
        ),
        Column(
            name="residual_elevation_rad",
            type="number",
            unit="rad",
            nullable=True,
            of_space=True,
            meaning="elevation, measured minus predicted at the estimate; null for a row of azimuth alone",
        ),
        Column(
            name="residual_m",
            type="number",
            unit="m",
            nullable=True,
            meaning="range or arrival, measured minus predicted at the estimate",
        ),
        Column(
            name="target", type="integer", nullable=True, meaning="target that the row is assigned to, numbered from 0"
        ),
        Column(
            name="under_horizon",
            type="boolean",
            nullable=True,
            of_horizons=True,
            meaning="whether the bearing is below the sensor's horizon, from which no circle or sphere reflects a wave",
        ),
        Column(
            name="los",
            type="boolean",
            nullable=True,
            meaning="whether the row agrees with its stated path, direct or by its reflector",
        ),
        Column(
            name="los_probability",
            type="number",
            nullable=True,
            meaning="probability of los, given all rows, alpha and a source in the search region (los: over a half)",
        ),
        Column(
            name="std_factor",
            type="number",
            nullable=True,
            meaning="factor of the row's standard deviation: estimated for its sensor (estimate_std), or that of a "
            "calibration",
        ),
        Column(name="ip", type="boolean", nullable=True, meaning="whether the path is indirect (triplets)"),
        Column(
            name="p_value",
            type="number",
            nullable=True,
            meaning="p-value: probability that a direct path has at least this test statistic",
        ),
        Column(name="reason", type="text", nullable=True, meaning="reason of the flag, or why there is no flag"),
        Column(
            name="blind",
            type="boolean",
            nullable=True,
            meaning="whether the rule cannot detect an indirect path in this geometry",
        ),
        Column(
            name="outside_safe_region",
            type="boolean",
            nullable=True,
            meaning="whether the difference is significantly larger than eta_m",
        ),
        Column(
            name="direct_probability",
            type="number",
            nullable=True,
            meaning="posterior probability that the path is direct to a common target",
        ),
        *(
            Column(
                name=f"residual_{name}_rad",
                type="number",
                unit="rad",
                nullable=True,
                of_space="elevation" in name,
                meaning=f"{name[:3].upper()}{name[3:].replace('_', ' ')}, measured minus predicted at the estimate",
            )
            for name in ("dod", "doa", "dod_elevation", "doa_elevation")
        ),
        *(
            Column(
                name=f"{points}_{axis}_m",
                type="number",
                unit="m",
                nullable=True,
                meaning=f"intersection of {points.replace('_', ' and ').upper().replace('AND', 'and')}",
            )
            for points in ("dod_doa", "dod_toa", "doa_toa")
            for axis in ("x", "y")
        ),
        *(
            Column(
                name=f"{word}{number}_m",
                type="number",
                unit="m",
                nullable=True,
                meaning=f"{meaning} {number}, in the frame of the baseline",
            )
            for word, meaning in (("lambda", "difference of intersections"), ("threshold", "threshold of difference"))
            for number in range(1, 7)
        ),
    ),
)

TRUTH = Table(
    name="truth",
    title="Truth: the true position of the source of each snapshot",
    columns=(
        Column(name="snapshot", type="identifier", required=True, meaning="as in the measurements"),
        Column(name="source", type="text", nullable=True, meaning="input of the snapshot, as in the estimates"),
        *TRUTH_POSITION,
        TRUTH_HEIGHT,
    ),
)
