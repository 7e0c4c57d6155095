"""The papers that the built-in methods' references name, in full (docs/references.bib has them for BibTeX)."""

from __future__ import annotations

__all__ = ["papers_of"]

_PAPERS = {
    "Song, Willett, Zhou 2013": "X. Song, P. Willett, S. Zhou, Bearings-Only Localization with NLOS Reflected AoAs, "
    "Journal of Advances in Information Fusion, 2013",
    "Stansfield 1947": "R. G. Stansfield, Statistical Theory of DF Fixing, Journal of the IEE 14(15), 762-770, 1947",
    "Liang, Zeng, Li": "Y. Liang, C. Zeng, H. Li, LOS Path Identification in Multipath Environments with an Unknown "
    "Number of Passive Targets, Stevens Institute of Technology",
    "Liang, Li 2023": "Y. Liang, H. Li, LOS Signal Identification for Passive Multi-Target Localization in Multipath "
    "Environments, IEEE Signal Processing Letters 30, 1597-1601, 2023",
    "Beck, Stoica, Li 2008": "A. Beck, P. Stoica, J. Li, Exact and Approximate Solutions of Source Localization "
    "Problems, IEEE Transactions on Signal Processing 56(5), 1770-1778, 2008",
    "Shen, Molisch 2012": "J. Shen, A. F. Molisch, Indirect Path Detection Based on Wireless Propagation "
    "Measurements, IEEE Transactions on Wireless Communications, 2012, doi:10.1109/TWC.2012.112012.120104",
    "Ananthasubramaniam, Madhow": "B. Ananthasubramaniam, U. Madhow, Cooperative Localization Using Angle of Arrival "
    "Measurements: Sequential Algorithms and Non-Line-of-Sight Suppression, University of California, Santa Barbara",
}


def papers_of(reference: str) -> list[str]:
    """Return in full the papers that a reference names; a plugin's names none of ours."""
    return [paper for key, paper in _PAPERS.items() if key in reference]
