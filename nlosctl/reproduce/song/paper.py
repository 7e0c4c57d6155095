"""Song, Willett, Zhou 2013: the paper with the errors in its text."""

from __future__ import annotations

from nlosctl.reproduce.experiment import Erratum, Paper

__all__ = ["PAPER"]

PAPER = Paper(
    name="song",
    reference="Song, Willett, Zhou 2013",
    errata=(
        Erratum(
            where="(2), (3), (34)",
            printed="arctan of a quotient",
            right="atan2: as printed (3) is wrong by pi in half of all geometries",
        ),
        Erratum(
            where="(1), (2), Table I",
            printed="superscript s on the image of the target; bars and tildes exchanged in Table I",
            right="superscript t, as in (49)",
        ),
        Erratum(
            where="after (2)",
            printed="the mirrored reference line has slope tan(2 a)",
            right="tan(2 arctan a)",
        ),
        Erratum(where="(34)", printed="x, y without superscript", right="the sensor's"),
        Erratum(
            where="(37), (38)",
            printed="t = tan(theta / 2)",
            right="t = cot(theta / 2): the curve is right, its parameter is not",
        ),
        Erratum(
            where="before (40)",
            printed="arc AD = arc BC = 2 arccos(r / R)",
            right="AD = 2 BC = 2 arccos(r / R)",
        ),
        Erratum(
            where="Lemma 3 and its proof",
            printed="reflectively visible region A1",
            right="A2; Lemma 2 calls A1 invisible",
        ),
        Erratum(
            where="Section 4",
            printed="geometric distortion by the tangent",
            right="no distortion: the mirror at the tangent reflects the very ray; only the weights are wrong",
        ),
        Erratum(
            where="Section 3.2, abstract",
            printed="no gradient, no Cramer-Rao bound for the circle",
            right="both in closed form: the bearing's gradient is the ray's normal over the spread of the ray tube",
        ),
    ),
)
