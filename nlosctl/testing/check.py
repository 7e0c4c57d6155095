"""The table of the laws, and running them on a method."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.contract.methods import MethodSpec
from nlosctl.testing import answer_laws, form_laws
from nlosctl.testing.bench import Bench, LawBroken
from nlosctl.testing.draws import DRAWS, Draw
from nlosctl.testing.reflected_draws import draws_of
from nlosctl.testing.space_draws import space_draws_of

__all__ = ["LAWS", "MethodLaw", "check_law", "check_method"]


@dataclass(frozen=True, kw_only=True)
class MethodLaw:
    """A law: ``check(bench)`` yields complaints. A method whose ``exempt_from`` has its name need not keep it."""

    name: str
    check: Callable[[Bench], Iterator[str]]

    @property
    def rule(self) -> str:
        """The law in one line."""
        return (self.check.__doc__ or "").strip().rstrip(".")


LAWS = (
    MethodLaw(name="specification", check=form_laws.specification),
    MethodLaw(name="shapes", check=form_laws.shapes),
    MethodLaw(name="sorted", check=form_laws.sorted_estimates),
    MethodLaw(name="null", check=form_laws.null),
    MethodLaw(name="covariance", check=form_laws.covariance),
    MethodLaw(name="flags", check=form_laws.flags),
    MethodLaw(name="read-only", check=form_laws.read_only),
    MethodLaw(name="quiet", check=form_laws.quiet),
    MethodLaw(name="empty", check=answer_laws.empty),
    MethodLaw(name="any-number", check=answer_laws.any_number),
    MethodLaw(name="deterministic", check=answer_laws.deterministic),
    MethodLaw(name="seeds", check=answer_laws.seeds),
    MethodLaw(name="batches", check=answer_laws.batches),
    MethodLaw(name="degenerate", check=answer_laws.degenerate),
    MethodLaw(name="order", check=answer_laws.order),
    MethodLaw(name="frame", check=answer_laws.frame),
    MethodLaw(name="answers", check=answer_laws.answers),
)
"""All laws, in the order in which `check_method` checks them."""


def check_method(spec: MethodSpec, *, seed: int = 0, options: Any = None, in_space: bool = False) -> None:
    """Check all laws on a method; raises LawBroken, which names the law, the method and the violation.

    ``seed`` draws other batches. ``options`` replaces the default options; it is needed if an option has no default.
    With ``in_space`` batches in three dimensions follow, for a method that declares them; searches take minutes.
    """
    for law in LAWS:
        check_law(spec, law, seed=seed, options=options)
    for draw in space_draws_of(spec) if in_space else ():
        for law in LAWS:
            check_law(spec, law, seed=seed, options=options, draw=draw)


def check_law(
    spec: MethodSpec, law: MethodLaw, *, seed: int = 0, options: Any = None, draw: Draw | None = None
) -> None:
    """Check one law on a method unless it is exempt; raises LawBroken. An exception of the method breaks the law.

    ``draw`` draws the batches; by default it follows from the method's kind and job.
    """
    if law.name in spec.exempt_from:
        return
    draws = draws_of(spec) if draw is None else [draw]
    if not draws:
        known = ", ".join(f"{kind} ({job})" for kind, job in sorted(DRAWS))
        complaint = f"no batches can be drawn for {spec.kind} ({spec.job}); there are: {known}"
        raise LawBroken(spec.full_name, law.name, law.rule, complaint)
    for number, chosen in enumerate(draws):
        words = [seed, zlib.crc32(law.name.encode()), *([number] if number else [])]
        _check_law_on(spec, law, options, chosen, np.random.default_rng(words))


def _check_law_on(spec: MethodSpec, law: MethodLaw, options: Any, draw: Draw, generator: np.random.Generator) -> None:
    try:
        chosen = spec.options() if options is None else options
        bench = Bench(spec=spec, options=chosen, draw=draw, generator=generator)
        complaint = next(law.check(bench), "")
    except Exception as error:  # any exception of a method breaks the law
        complaint = f"it raised {type(error).__name__}: {error}"
        raise LawBroken(spec.full_name, law.name, law.rule, complaint) from error
    if complaint:
        raise LawBroken(spec.full_name, law.name, law.rule, complaint)
