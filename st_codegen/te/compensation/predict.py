"""FB_TEPredict: the harmonics of the transmission error at an operating point."""

from __future__ import annotations

from st_codegen.emit.blocks.listing import Block, BlockVariable, CodeSection
from st_codegen.emit.blocks.model import block_name, feature_text, header_lines, input_variables
from st_codegen.emit.literals import real
from st_codegen.te.compensation.parts import HARMONICS_TYPE, SUFFIX, boolean, lreal, names_of, set_variables
from st_codegen.te.harmonics import AxisCorrection, Direction, Quantity, TransmissionError


def predict_block(te: TransmissionError) -> Block:
    """Amplitudes and phases, and cosine and sine parts, of all harmonics in both directions."""
    inputs = input_variables(te.features)
    models = list(dict.fromkeys(output.model for output in te.outputs))
    instances = {
        model: BlockVariable(f"fb{block_name(model)[3:]}", block_name(model), comment=f"model {model}")
        for model in models
    }
    names = {model: instance.name for model, instance in instances.items()}
    harmonics = [
        _harmonic(te, direction, number, names) for direction in te.directions for number in range(len(te.orders))
    ]
    return Block(
        "FB_TEPredict",
        header_lines(*_header(te)),
        inputs=inputs,
        outputs=_outputs(te),
        variables=(
            boolean("bUsable", "nothing has gone wrong so far"),
            *([] if te.cycles else [boolean("bInside", "no input was found outside of its range")]),
            *_spread_variables(te),
            *instances.values(),
            lreal("fAmplitude", "A, deg"),
            lreal("fPhase", "phi, rad"),
            lreal("fCosine", "A * cos(phi), deg"),
            lreal("fSine", "A * sin(phi), deg"),
        ),
        sections=(
            CodeSection(
                "what is no number is refused, also for models that know missing values",
                "te_inputs",
                {"inputs": names_of(inputs), "spread": bool(te.cycles)},
            ),
            *_model_sections(te, inputs, names),
            CodeSection(
                "amplitudes, phases and parts",
                "te_harmonics",
                {"harmonics": harmonics, "calls": len(te.cycles), "usable": "bRound" if te.cycles else "bUsable"},
            ),
        ),
    )


def _model_sections(
    te: TransmissionError, inputs: tuple[BlockVariable, ...], instances: dict[str, str]
) -> tuple[CodeSection, ...]:
    """The calls of the models; a model block names its inputs by its own features, which the bundle's are."""
    if not te.cycles:
        return (CodeSection("models", "te_models", {"instances": list(instances.values()), "inputs": inputs}),)
    parts = [
        {"number": number, "instances": [instances[name] for name in names]} for number, names in enumerate(te.cycles)
    ]
    return (CodeSection(f"models, spread over {len(parts)} calls", "te_spread", {"parts": parts, "inputs": inputs}),)


def _spread_variables(te: TransmissionError) -> tuple[BlockVariable, ...]:
    if not te.cycles:
        return ()
    return (
        BlockVariable("nPart", "DINT", comment="which of the calls of a round comes next"),
        BlockVariable("aPoint", "LREAL", len(te.features), comment="operating point of the round"),
        boolean("bRound", "nothing has gone wrong in this round"),
        boolean("bRoundInside", "no input of this round had to be limited"),
    )


def _harmonic(te: TransmissionError, direction: Direction, number: int, instances: dict[str, str]) -> dict[str, object]:
    order = te.orders[number]
    of = {
        quantity.value: f"{instances[output.model]}.fOut{output.output + 1}"
        for quantity, output in te.quantities(direction, order).items()
    }
    correction = te.correction(direction, order)
    added = te.terms(direction, order)
    terms = {
        quantity.value: [f"{instances[term.model]}.fOut{term.output + 1}" for term in added.get(quantity, ())]
        for quantity in Quantity
    }
    return {
        "index": number,
        "order": order,
        "suffix": SUFFIX[direction],
        "direction": direction,
        "of": of,
        "own": _numbers(correction) if correction is not None else None,
        "added": bool(added),
        "terms": terms,
    }


def _numbers(correction: AxisCorrection) -> dict[str, object]:
    """The numbers of a correction; of those that are added, magnitude and sign."""
    along, across = correction.parts
    added = correction.turn_rad if correction.order else correction.offset_deg
    return {
        "factor": real(correction.factor),
        "along": real(along),
        "across": real(abs(across)),
        "across_negative": across < 0,
        "added": real(abs(added)),
        "added_negative": added < 0,
    }


def _outputs(te: TransmissionError) -> tuple[BlockVariable, ...]:
    polar = []
    for direction in te.directions:
        suffix = SUFFIX[direction]
        polar.append(BlockVariable(f"aAmplitude{suffix}", HARMONICS_TYPE, comment=f"A_k {direction}, deg"))
        polar.append(BlockVariable(f"aPhase{suffix}", HARMONICS_TYPE, comment=f"phi_k {direction}, rad"))
    return (
        *polar,
        *set_variables(te),
        boolean("bValid", f"the outputs belong to the inputs of {'an earlier' if te.cycles else 'this'} call"),
        boolean("bInRange", "no input had to be limited to its declared range"),
    )


def _header(te: TransmissionError) -> tuple[str, ...]:
    return (
        "FB_TEPredict: harmonics of the transmission error at an operating point",
        f"Bundle: {te.name}",
        "TE(theta) = sum over k of A_k * cos(k * theta + phi_k), theta the angle of the output shaft;",
        "k = 0 is the mean, with its sign and without a phase.",
        *(
            [
                f"The models are spread over {len(te.cycles)} calls. The outputs change with the last of them and",
                f"belong to the operating point of {len(te.cycles) - 1} to {2 * len(te.cycles) - 2} calls before.",
            ]
            if te.cycles
            else []
        ),
        *(f"Index {number}: order {order}" for number, order in enumerate(te.orders)),
        *(["The models are those of several axes; this axis has of what they predict:"] if te.corrections else []),
        *(f"Order {own.order} {own.direction}: {own}" for own in te.corrections),
        *(f"Input {number}: {feature_text(feature)}" for number, feature in enumerate(te.features, 1)),
    )
