import math
import re
import unicodedata

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_numerics.interpolation.kernels import BASES, basis_named, checked_radius, slopes, values
from mesh_motion_protocol.errors import InvalidInput

USABLE = sorted(name for name, basis in BASES.items() if not basis.unusable)
COMPACT = sorted(name for name, basis in BASES.items() if basis.compact)


def c2(x: float) -> float:
    return max(1 - x, 0) ** 4 * (4 * x + 1)


def c2_slope(x: float) -> float:
    return -20 * x * max(1 - x, 0) ** 3


#: Tables 2.1 and 2.2 as Python reads them, with 80/3 for CTPS C1 and (1 − ξ)⁵ … as printed; and the sum.
FORMULAS = {
    "wendland-c0": lambda x: (1 - x) ** 2,
    "wendland-c2": c2,
    "wendland-c2-multiscale": lambda x: sum(c2(2**k * x) / 4**k for k in range(4)) * 64 / 85,
    "wendland-c4": lambda x: (1 - x) ** 6 * (35 / 3 * x**2 + 6 * x + 1),
    "wendland-c6": lambda x: (1 - x) ** 8 * (32 * x**3 + 25 * x**2 + 8 * x + 1),
    "ctps-c0": lambda x: (1 - x) ** 5,
    "ctps-c1": lambda x: 1 + 80 / 3 * x**2 - 40 * x**3 + 15 * x**4 - 8 / 3 * x**5 + 20 * x**2 * math.log(x),
    "ctps-c2a": lambda x: 1 - 30 * x**2 - 10 * x**3 + 45 * x**4 - 6 * x**5 - 60 * x**3 * math.log(x),
    "ctps-c2b": lambda x: 1 - 20 * x**2 + 80 * x**3 - 45 * x**4 - 16 * x**5 + 60 * x**4 * math.log(x),
    "tps": lambda x: x**2 * math.log(x),
    "mqb": lambda x: math.sqrt(1 + x**2),
    "imqb": lambda x: math.sqrt(1 / (1 + x**2)),
    "qb": lambda x: 1 + x**2,
    "iqb": lambda x: 1 / (1 + x**2),
    "gauss": lambda x: math.exp(-(x**2)),
}


def test_the_table_has_the_fourteen_rows_of_the_thesis_and_a_sum():
    assert sorted(basis.number for basis in BASES.values()) == list(range(15))
    assert set(BASES) == set(FORMULAS)
    assert sorted(basis.code for basis in BASES.values()) == list(range(15))
    assert [name for name, basis in BASES.items() if basis.unusable] == ["qb"]


@pytest.mark.parametrize("name", sorted(BASES))
@given(xi=st.floats(1e-6, 1.0))
def test_values_are_the_printed_formulas(name, xi):
    # the polynomials of CTPS cancel from terms of size 60 to zero at ξ = 1
    assert values(BASES[name], [xi])[0] == pytest.approx(FORMULAS[name](xi), rel=1e-12, abs=3e-14)


@pytest.mark.parametrize("name", sorted(BASES))
@given(xi=st.floats(1e-2, 0.99))
def test_slopes_are_the_derivatives(name, xi):
    h = 1e-6
    difference = (FORMULAS[name](xi + h) - FORMULAS[name](xi - h)) / (2 * h)
    assert slopes(BASES[name], [xi])[0] * xi == pytest.approx(difference, rel=1e-6, abs=1e-7)


def python_of(text):
    text = re.sub("[²-³⁴-⁸]", lambda power: f"**{unicodedata.digit(power[0])}", text)
    text = text.partition(",")[0].replace("φ'", "slope")
    text = text.replace("√", "sqrt").replace("^", "**").replace("log ξ", "log(ξ)")
    return re.sub(r"(?<=[\dξ)]) ?(?=[ξ(φ]|log|exp|slope)", "*", text)


@pytest.mark.parametrize("name", sorted(BASES))
@pytest.mark.parametrize("xi", [0.1, 0.5, 0.9])
def test_the_table_s_text_is_what_is_compiled(name, xi):
    basis = BASES[name]
    names = {"ξ": xi, "log": math.log, "exp": math.exp, "sqrt": math.sqrt, "φ": c2, "slope": c2_slope}
    formula, derivative = (eval(python_of(text), {}, names) for text in (basis.formula, basis.derivative))
    assert values(basis, xi) == pytest.approx(formula, rel=1e-12, abs=1e-14)
    assert slopes(basis, xi) * xi == pytest.approx(derivative, rel=1e-12, abs=1e-13)


@pytest.mark.parametrize("name", COMPACT)
def test_compact_functions_are_one_at_the_centre_and_vanish_smoothly_at_the_radius(name):
    basis = BASES[name]
    assert values(basis, 0.0) == pytest.approx(1.0, abs=1e-15)
    assert abs(values(basis, 1.0)) < 1e-13
    assert abs(slopes(basis, 1.0)) < 1e-13  # without 80/3 in CTPS C1 this would be -40/3
    assert (values(basis, [1.0 + 1e-12, 2.0, 1e300]) == 0).all()
    assert (slopes(basis, [1.0 + 1e-12, 2.0, 1e300]) == 0).all()


@pytest.mark.parametrize("name", sorted(BASES))
def test_gradient_at_the_centre_exists_where_the_table_says_so(name):
    slope_of_approach = abs(slopes(BASES[name], 1e-9) * 1e-9)  # |φ'| close to the centre
    assert (slope_of_approach < 1e-6) == BASES[name].gradient_at_centre


@pytest.mark.parametrize("name", [n for n in USABLE if BASES[n].order == 0])
@pytest.mark.parametrize("d", [1, 2, 3])
def test_definite_functions_give_definite_matrices(name, d):
    points = np.random.default_rng(d).random((40, d))
    if d == 1:
        points = np.linspace(0, 1, 40)[:, None]
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    radius = 0.5 if BASES[name].compact else 0.05
    assert np.linalg.eigvalsh(values(BASES[name], distance / radius))[0] > 0


@pytest.mark.parametrize(("name", "sign"), [("tps", 1), ("mqb", -1)])
def test_conditionally_definite_on_the_complement_of_polynomials(name, sign):
    points = np.random.default_rng(0).random((40, 2))
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    p = np.column_stack([np.ones(40), points])[:, : 1 if BASES[name].order == 1 else 3]
    null = np.linalg.qr(p, mode="complete")[0][:, p.shape[1] :]
    assert np.linalg.eigvalsh(sign * null.T @ values(BASES[name], distance / 0.2) @ null)[0] > 0


def test_qb_has_rank_d_plus_two():
    points = np.random.default_rng(0).random((30, 3))
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    assert np.linalg.matrix_rank(values(BASES["qb"], distance)) == 5
    with pytest.raises(InvalidInput, match=r"'qb' cannot interpolate: it is a polynomial.*rank d \+ 2"):
        basis_named("qb")


def test_unknown_names_are_answered_with_the_known_ones():
    known = "wendland-c0, wendland-c2, .*gauss, wendland-c2-multiscale"
    with pytest.raises(InvalidInput, match=rf"unknown basis 'wendland' \(known are {known}\)"):
        basis_named("wendland")


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_radius_must_be_finite_and_positive(radius):
    with pytest.raises(InvalidInput, match="finite support radius > 0"):
        checked_radius(radius, BASES["wendland-c2"])


def test_a_missing_radius_is_refused_where_it_means_something():
    assert checked_radius(None, BASES["tps"]) == 1.0
    for name in ("gauss", "iqb", "imqb", "mqb"):
        with pytest.raises(InvalidInput, match=f"'{name}' needs a shape parameter"):
            checked_radius(None, BASES[name])
    with pytest.raises(InvalidInput, match="'wendland-c2' needs its support radius"):
        checked_radius(None, BASES["wendland-c2"])


def test_the_logarithm_and_the_exponential_are_the_librarys_to_the_last_bits():
    """They are written out, so that they become vector instructions."""
    xi = np.exp(np.random.default_rng(0).uniform(-30.0, 30.0, 100_000))
    np.testing.assert_allclose(values(BASES["tps"], xi), xi * xi * np.log(xi), rtol=1e-15, atol=0)
    xi = np.random.default_rng(1).uniform(0.0, 26.0, 100_000)
    np.testing.assert_allclose(values(BASES["gauss"], xi), np.exp(-(xi * xi)), rtol=1e-15, atol=0)
    assert (values(BASES["gauss"], [30.0, 1e150]) == 0.0).all()
