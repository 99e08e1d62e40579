"""FB_HarmonicSum: the sum of Eq. 2 with one SIN and one COS."""

from __future__ import annotations

import math
from dataclasses import dataclass

from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import header_lines
from st_codegen.emit.literals import real
from st_codegen.errors import at_most, counted
from st_codegen.te.compensation.addition_chain import ChainLink, addition_chain
from st_codegen.te.compensation.parts import HARMONICS_TYPE, dint, lreal
from st_codegen.te.harmonics import TransmissionError

#: pi / 2 in three parts: multiples up to 2**30 of the first two are exact in LREAL (23 significant bits each).
HALF_PI_HIGH = 1.570796251296997
HALF_PI_MIDDLE = 7.549789415861596e-08
HALF_PI_LOW = 5.390302858158119e-15

#: Bound on the error of cos(k*theta) and sin(k*theta), for each unit of k, where SIN and COS are good to 0.55 ulp:
#: 0.78 u (the two functions) + 0.5 u (the reduced angle) + sqrt(5) u (one complex multiplication; Brent, Percival and
#: Zimmermann, Math. Comp. 76, 2007), u = 2**-53. Every chain multiplies k - 1 times, counted with repetition.
ERROR_PER_ORDER = 3.6 * 2.0**-53


@dataclass(frozen=True)
class Operations:
    """What one evaluation costs, the reduction of the angle included."""

    chain: tuple[ChainLink, ...]
    multiplications: int
    additions: int


def operations(orders: tuple[int, ...]) -> Operations:
    """The chain for a set of orders, and the number of operations."""
    chain = addition_chain(order for order in orders if order > 0)
    terms = sum(order > 0 for order in orders)
    squares = sum(link.first == link.second for link in chain)
    products = len(chain) - squares
    # reduction: one product for the quadrant and three of pi/2; the terms: two products each
    return Operations(chain, 4 + 4 * len(chain) + 2 * terms, 4 + squares + 2 * products + 2 * terms + (0 in orders))


def harmonic_sum_block(te: TransmissionError) -> Block:
    """The sum of all harmonics at an angle, from their cosine and sine parts."""
    cost = operations(te.orders)
    numbers = [1, *(link.number for link in cost.chain)]
    terms = [{"index": index, "order": order} for index, order in enumerate(te.orders)]
    largest = max(te.orders)
    chain = ", ".join(map(str, numbers))
    return Block(
        "FB_HarmonicSum",
        header_lines(
            "FB_HarmonicSum: sum over k of aCosine[k] * cos(k * theta) - aSine[k] * sin(k * theta)",
            f"Orders: {', '.join(map(str, te.orders))}",
            "cos and sin of theta give those of all multiples by complex multiplication along an addition chain:",
            f"Chain: {chain}",
            f"Cost: 1 COS, 1 SIN, {counted(len(cost.chain), 'complex multiplication')}; in all "
            f"{counted(cost.multiplications, 'multiplication')} and {counted(cost.additions, 'addition')} of LREAL.",
            "Error of each cosine and sine: below k * 4.0E-16, "
            f"{at_most(largest * 4e-16).upper()} for order {largest}.",
            "The angle is reduced to -pi/4 .. pi/4 first, so that many turns cost no accuracy.",
        ),
        inputs=(
            lreal("fTheta_rad", "angle of the output shaft, within +-1.0E9 rad"),
            BlockVariable("aCosine", HARMONICS_TYPE, comment="A_k * cos(phi_k), deg"),
            BlockVariable("aSine", HARMONICS_TYPE, comment="A_k * sin(phi_k), deg"),
        ),
        outputs=(lreal("fSum_deg", "the sum, deg"),),
        variables=(
            lreal("fTurns", "quarter turns"),
            dint("nTurns", "quarter turns, whole"),
            dint("nQuadrant", "0 .. 3"),
            lreal("fRest", "reduced angle, rad"),
            lreal("fCos", "cosine of the reduced angle"),
            lreal("fSin", "sine of the reduced angle"),
            *(
                variable
                for number in numbers
                for variable in (
                    lreal(f"fC{number}", f"cos({number} * theta)" if number > 1 else "cos(theta)"),
                    lreal(f"fS{number}", f"sin({number} * theta)" if number > 1 else "sin(theta)"),
                )
            ),
        ),
        constants=(
            lreal("TURNS_PER_RAD", "2 / pi", real(2.0 / math.pi)),
            lreal("HALF_PI_HIGH", "pi / 2, first 23 bits", real(HALF_PI_HIGH)),
            lreal("HALF_PI_MIDDLE", "next 23 bits", real(HALF_PI_MIDDLE)),
            lreal("HALF_PI_LOW", "the rest", real(HALF_PI_LOW)),
        ),
        sections=(
            CodeSection("angle reduced by quarter turns", "te_reduce", {}),
            CodeSection("multiples along the chain", "te_chain", {"links": cost.chain}),
            CodeSection("sum", "te_terms", {"terms": terms}),
        ),
    )
