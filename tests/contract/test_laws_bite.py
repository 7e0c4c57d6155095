"""Each law can fail: for each there is a toy method that breaks it, and no other."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import toys

from nlosctl.contract.methods import CONTRACT_VERSION, MethodSpec
from nlosctl.contract.results import Flags
from nlosctl.methods import ranges_r_ls
from nlosctl.testing import LAWS, LawBroken, check_law, check_method

BROKEN: list[tuple[str, MethodSpec]] = [
    ("specification", dataclasses.replace(toys.toy(), name="My Toy")),
    (
        "specification",
        toys.toy(lambda batch, _: toys.SOUND.solve(batch, toys.SOUND.options()), options=toys.ThawedOptions),
    ),
    ("specification", toys.toy(contract_version=None)),
    ("specification", dataclasses.replace(toys.SOUND, contract_version=None, summary="Another of this name")),
    ("specification", toys.toy(contract_version=CONTRACT_VERSION + 1)),
    ("shapes", toys.toy(toys.narrow_counts)),
    ("shapes", toys.toy(covariance_kinds=("inliers",))),
    ("sorted", toys.toy(toys.backwards)),
    ("null", toys.toy(toys.made_up_numbers)),
    ("covariance", toys.toy(toys.negative_covariance)),
    ("flags", toys.toy(toys.undeclared_flag)),
    ("flags", toys.toy(flags=("residual_rad", "p_value"))),
    ("read-only", toys.toy(toys.writes_its_input)),
    ("quiet", toys.toy(toys.warns)),
    ("quiet", toys.toy(toys.prints)),
    ("empty", toys.toy(toys.needs_a_snapshot)),
    ("any-number", toys.toy(toys.needs_two)),
    ("any-number", toys.toy(minimum_measurements=3)),
    ("deterministic", toys.toy(toys.starts_where_it_was())),
    ("seeds", toys.toy(toys.undeclared_chance)),
    ("batches", toys.toy(toys.sum_in_pairs)),
    ("degenerate", toys.toy(toys.one_singular_fails_all)),
    ("order", toys.toy(toys.trusts_the_first)),
    ("frame", toys.toy(toys.knows_north)),
    ("answers", toys.toy(toys.gives_up)),
]


COMPLAINTS: list[tuple[str, MethodSpec, str]] = [
    ("specification", toys.toy(summary=""), "its summary, reference or cost is empty"),
    ("specification", toys.toy(minimum_measurements=0), "minimum_measurements is 0"),
    ("specification", toys.toy(flags=("used",)), "each once, 'used' not among them"),
    ("specification", toys.toy(options=toys.BareOptions), "'speed' is not declared with"),
    ("specification", toys.toy(options=toys.WildOptions), "a default is not allowed: The 'share' parameter"),
    ("shapes", toys.toy(toys.other_estimates(lambda e: {"status": e.status | 64})), "a status is 6[45]"),
    (
        "sorted",
        toys.toy(toys.other_estimates(lambda e: {"row": np.minimum(e.row, 9)})),
        r"\(9, 0, 0\) follows \(9, 0, 0\)",
    ),
    ("null", toys.toy(toys.other_estimates(lambda e: {"n_used": e.n_used + 9})), "n_used is 9 of 2"),
    ("null", toys.toy(toys.other_estimates(lambda e: {"cost": e.cost * np.nan})), "the cost is nan where"),
    ("flags", toys.toy(toys.other_flags(lambda flags: None)), "missing although the batch wants them"),
    ("flags", toys.toy(toys.other_flags(lambda f: Flags(used=f.used * 1.0, columns=f.columns))), "used is float64"),
    ("flags", toys.toy(toys.other_flags(lambda f: Flags(used=f.used[:1], columns=f.columns))), "used has shape"),
    (
        "flags",
        toys.toy(toys.other_flags(lambda f: Flags(used=~f.used, columns=f.columns))),
        "2 rows used, but n_used is 0",
    ),
    (
        "flags",
        toys.toy(toys.other_estimates(lambda e: {"cost": e.cost + 1.0}, without_flags=True)),
        "when the batch wants no flags, cost differs",
    ),
    ("batches", toys.toy(toys.more_flags_for_few), "flags.extra is there only once"),
    (
        "frame",
        toys.toy(toys.other_estimates(lambda e: {"cost": e.cost + 1e-6 * e.position_m[:, 0]})),
        "the cost of estimate .* is .*, not",
    ),
    (
        "frame",
        toys.toy(toys.other_estimates(lambda e: {"covariance_m2": e.covariance_m2 * np.array([1.0, 1.0, 1.0001])})),
        "the covariance of estimate .* is off",
    ),
    (
        "frame",
        toys.toy(toys.other_estimates(lambda e: {"status": np.where(e.position_m[:, 0] > 0.0, e.status, 1)})),
        "status differs: at",
    ),
]


@pytest.mark.parametrize(
    ("law", "spec", "message"), COMPLAINTS, ids=[f"{law}: {message}" for law, _, message in COMPLAINTS]
)
def test_complaints_state_the_fault(law: str, spec: MethodSpec, message: str) -> None:
    """The complaint states what is wrong, with the numbers."""
    (found,) = (one for one in LAWS if one.name == law)
    with pytest.raises(LawBroken, match=message):
        check_law(spec, found)


def laws_broken_by(spec: MethodSpec) -> set[str]:
    """Return the names of all laws that a method breaks."""
    broken = set()
    for law in LAWS:
        try:
            check_law(spec, law)
        except LawBroken as error:
            broken.add(error.law)
    return broken


def test_every_law_has_a_method_that_breaks_it() -> None:
    """Every law has a toy that breaks it."""
    assert {law for law, _ in BROKEN} == {law.name for law in LAWS}


def test_the_sound_toy_breaks_no_law() -> None:
    """The toy without a fault obeys all laws, so that only the fault of a broken toy is detected."""
    check_method(toys.toy())


@pytest.mark.extensive
@pytest.mark.parametrize(("law", "spec"), BROKEN, ids=[f"{law}-{number}" for number, (law, _) in enumerate(BROKEN)])
def test_each_fault_breaks_one_law(law: str, spec: MethodSpec) -> None:
    """A method with one fault breaks that law and no other."""
    assert laws_broken_by(spec) == {law}


def test_the_complaint_names_method_law_and_fault() -> None:
    """The message of LawBroken names the method, the law with its rule, and what is wrong."""
    with pytest.raises(LawBroken, match=r"bearings\.toy breaks the law 'quiet' \(It neither .*\): it prints 'solving"):
        check_method(toys.toy(toys.prints))


def test_a_missing_contract_version_is_reported() -> None:
    """A plugin without a contract version fails the check; built-in methods need none."""
    with pytest.raises(LawBroken, match=r"breaks the law 'specification' .*: it doesn't state .*contract_version=1$"):
        check_method(toys.toy(contract_version=None))
    check_method(toys.SOUND)


@pytest.mark.parametrize(("law", "solve"), [("order", toys.trusts_the_first), ("frame", toys.knows_north)])
def test_exempt_methods_skip_the_law(law: str, solve: Any) -> None:
    """A method that declares an exemption passes without that law."""
    check_method(toys.toy(solve, exempt_from=frozenset({law})))


def test_an_exception_breaks_the_law() -> None:
    """An exception of a method breaks the law; the error reports and chains it."""

    def fail(batch: Any, options: Any) -> Any:
        raise ZeroDivisionError("no sensors")

    with pytest.raises(LawBroken, match="it raised ZeroDivisionError: no sensors") as caught:
        check_method(toys.toy(fail))
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


def test_unknown_kinds_are_refused() -> None:
    """A method for a kind that cannot be drawn is an error that lists the kinds."""
    with pytest.raises(LawBroken, match=r"no batches can be drawn for smells \(localize\); there are: arrivals"):
        check_method(toys.toy(kind="smells"))


def test_options_without_defaults_can_be_given() -> None:
    """``options`` replace the defaults."""
    seen = []

    def remember(batch: Any, options: Any) -> Any:
        seen.append(options.min_range_m)
        return toys.SOUND.solve(batch, options)

    options = toys.SOUND.options(min_range_m=1e-6)
    check_method(toys.toy(remember), options=options)
    assert set(seen) == {1e-6}


def test_methods_that_read_reflectors_are_tried_with_them() -> None:
    """Ranges by mirrors are drawn for a method that declares to read ``reflector``, and for no other."""
    seen: list[bool] = []

    def solve(batch: Any, options: Any) -> Any:
        seen.append(batch.reflector is not None and bool((batch.reflector >= 0).any()))
        return ranges_r_ls.METHOD.solve(batch, options)

    law = next(law for law in LAWS if law.name == "shapes")
    spec = dataclasses.replace(ranges_r_ls.METHOD, solve=solve)
    check_law(spec, law)
    assert set(seen) == {False, True}
    seen.clear()
    check_law(dataclasses.replace(spec, reads=frozenset()), law)
    assert set(seen) == {False}
