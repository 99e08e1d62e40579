"""FB_HarmonicSum against cosines of extended precision, and the cost that its header states."""

import re
from fractions import Fraction

import numpy as np
import pytest

from st_codegen.st import Machine
from st_codegen.te.compensation.harmonic_sum import ERROR_PER_ORDER, HALF_PI_LOW, operations
from tests.te.projects import PAPER_ORDERS, loaded, project, texts

LONG = np.longdouble
HALF_PI = Fraction("1.57079632679489661923132169163975144209858469968755291048747229615390820314310449931")
needs_long_double = pytest.mark.skipif(
    np.finfo(np.longdouble).nmant < 63, reason="no extended precision to compare with on this machine"
)


def angles(random, size):
    """Angles of all sizes that are accepted, multiples of a quarter turn and their neighbours among them."""
    quarter = random.integers(-(2**29), 2**29, size) * (np.pi / 2)
    near = np.nextafter(quarter, random.choice([-np.inf, np.inf], size))
    kinds = [
        random.uniform(-np.pi, np.pi, size),
        random.uniform(-200, 200, size),
        random.uniform(-1e9, 1e9, size),
        quarter,
        near,
        random.uniform(-1, 1, size) * 10.0 ** random.integers(-300, 0, size),
    ]
    return np.concatenate([*kinds, [0.0, -0.0, 5e-324, 1e9, -1e9]])


def exact(order, theta):
    """cos and sin of order * theta; the product of 53 and 8 bits is exact in 64."""
    product = LONG(order) * theta.astype(LONG)
    assert np.all(np.abs(product) < LONG(2) ** 62)
    return np.cos(product), np.sin(product)


@needs_long_double
@pytest.mark.parametrize("target", ["twincat", "iec"])
def test_every_order_up_to_240_is_within_its_bound_of_the_cosine(target):
    theta = angles(np.random.default_rng(3), 2_500)
    block = Machine(loaded(target, PAPER_ORDERS), rows=len(theta)).instance("FB_HarmonicSum")
    largest = 0.0
    for index, order in enumerate(PAPER_ORDERS):
        for number in (0, 1):
            sets = np.zeros((2, len(PAPER_ORDERS)))
            sets[number, index] = 1.0
            block(fTheta_rad=theta, aCosine=sets[0], aSine=sets[1])
            wanted = exact(order, theta)[number] * (1, -1)[number] if order else LONG(1 - number)
            error = np.max(np.abs(block["fSum_deg"].astype(LONG) - wanted))
            # the bound of one order: derived in harmonic_sum.py
            assert error <= order * ERROR_PER_ORDER
            largest = max(largest, float(error))
    assert 240 * ERROR_PER_ORDER < 1e-13
    assert largest < 1e-13


def test_the_reduced_angle_is_right_to_half_a_unit():
    theta = angles(np.random.default_rng(4), 400)
    block = Machine(loaded("iec", PAPER_ORDERS), rows=len(theta)).instance("FB_HarmonicSum")
    block(fTheta_rad=theta)
    rest = block["fRest"]
    assert np.max(np.abs(rest)) <= np.pi / 4 * (1 + 1e-7)
    for angle, turns, got in zip(theta.tolist(), block["fTurns"].tolist(), rest.tolist(), strict=True):
        wanted = Fraction(angle) - Fraction(turns) * HALF_PI
        # half a unit of the result, and the rounding of up to 2**30 times the third part of pi/2
        third = 2.0**30 * HALF_PI_LOW * 2.0**-53
        assert abs(Fraction(got) - wanted) <= Fraction(float(np.spacing(abs(got)) / 2)) + Fraction(third)


def test_the_header_states_the_operations_that_the_text_has():
    text = next(text for path, text in texts(project(PAPER_ORDERS), "twincat").items() if "FB_HarmonicSum" in path)
    cost = operations(PAPER_ORDERS)
    header = text.split("*)", 1)[0]
    assert f"{cost.multiplications} multiplications and {cost.additions} additions" in " ".join(header.split())
    body = text[text.index("<ST>") :]
    assert (body.count("COS("), body.count("SIN(")) == (1, 1)
    code = "\n".join(re.sub(r"\(\*.*?\*\)", "", line) for line in body.splitlines())
    # of the two roundings by half a turn one is made; the quadrant is integer arithmetic
    counted = code.replace("nTurns + 1073741824", "").replace("TRUNC(fTurns - 0.5)", "")
    assert counted.count("*") == cost.multiplications
    assert len(re.findall(r" [+-] ", counted)) == cost.additions


def test_a_long_list_of_orders_still_compiles():
    orders = tuple(range(0, 121, 3))
    block = Machine(loaded("iec", orders), rows=3).instance("FB_HarmonicSum")
    theta = np.array([0.3, 1e6, -7.0])
    cosine = 1.0 / (1 + np.arange(len(orders)))
    block(fTheta_rad=theta, aCosine=cosine, aSine=-cosine)
    angle = np.array(orders) * theta[:, None]
    assert block["fSum_deg"] == pytest.approx((np.cos(angle) + np.sin(angle)) @ cosine, abs=1e-8)
