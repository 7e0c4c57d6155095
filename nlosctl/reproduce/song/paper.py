"""Song, Willett, Zhou 2013: the paper with the errors in its text."""

from __future__ import annotations

from nlosctl.reproduce.experiment import Erratum, Paper

__all__ = ["PAPER"]

PAPER = Paper(
    name="song",
    reference="Song, Willett, Zhou 2013",
    ours=(
        "The unit of the noise in Fig. 8 and Fig. 9: degrees, of the bearing from the +x axis.",
        "The grid search of Fig. 9: vertices that the scene does not allow are left out; without another there is no "
        "estimate. That the region is about the least-squares fix is the text's.",
    ),
    errata=(
        Erratum(
            "(2), (3), (34)", "arctan of a quotient", "atan2: as printed (3) is wrong by pi in half of all geometries"
        ),
        Erratum(
            "(1), (2), Table I",
            "superscript s on the image of the target; bars and tildes exchanged in Table I",
            "superscript t, as in (49)",
        ),
        Erratum("after (2)", "the mirrored reference line has slope tan(2 a)", "tan(2 arctan a)"),
        Erratum("(34)", "x, y without superscript", "the sensor's"),
        Erratum("(37), (38)", "t = tan(theta / 2)", "t = cot(theta / 2): the curve is right, its parameter is not"),
        Erratum("before (40)", "arc AD = arc BC = 2 arccos(r / R)", "AD = 2 BC = 2 arccos(r / R)"),
        Erratum("Lemma 3 and its proof", "reflectively visible region A1", "A2; Lemma 2 calls A1 invisible"),
        Erratum(
            "Section 4",
            "geometric distortion by the tangent",
            "no distortion: the mirror at the tangent reflects the very ray; only the weights are wrong",
        ),
        Erratum(
            "Section 3.2, abstract",
            "no gradient, no Cramer-Rao bound for the circle",
            "both in closed form: the bearing's gradient is the ray's normal over the spread of the ray tube",
        ),
    ),
)
