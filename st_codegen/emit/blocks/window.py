"""A block with memory: it takes samples one by one and calls a model's block with the newest of them."""

from __future__ import annotations

from dataclasses import dataclass

from st_codegen.emit.blocks.listing import Block, BlockVariable, Listing
from st_codegen.emit.blocks.model import AGE, header_lines
from st_codegen.errors import InputError, counted

#: Behind the name of the model's block.
SUFFIX = "Window"


@dataclass(frozen=True)
class Window:
    """How the features of a model are made of samples.

    `length` samples in a row, the oldest first; `samples` names what one sample has (empty: `fSample`, or `fSample1`,
    ..). `by_sample`: the features are the first sample, then the second, ..; else the first number of all samples, then
    the second number of all, ..
    """

    length: int
    samples: tuple[str, ...] = ()
    by_sample: bool = True

    def names(self, features: int) -> tuple[str, ...]:
        """The numbers of one sample. Raises InputError where so many features are not whole samples."""
        count, rest = divmod(features, self.length)
        if rest or not count or len(self.samples) not in (0, count):
            each = f" of {counted(len(self.samples), 'number')}" if self.samples else ""
            raise InputError(
                f"a window of {self.length} samples{each} for {counted(features, 'feature')}: they are not as many"
            )
        return self.samples or (("fSample",) if count == 1 else tuple(f"fSample{n + 1}" for n in range(count)))


def window_block(block: Block, window: Window) -> Block:
    """The block that keeps the newest samples for a model's `block`."""
    names = window.names(len(block.inputs))
    results = tuple(port for port in block.outputs if port.name != AGE)  # which counts calls of the model's block
    listing = Listing(len(block.inputs))
    listing.local("fbModel", block.name)
    for name in ("aRing", "aWindow"):
        listing.local(name, "LREAL", len(block.inputs))
    for name in ("nAt", "nNext", "nSample"):
        listing.local(name, "DINT")
    ports = {variable.name.lower() for variable in (*block.outputs, *listing.variables.values())} | {"nsamples"}
    if taken := [name for name in names if name.lower() in ports]:
        raise InputError(f"{block.name}{SUFFIX}: {taken[0]} is the name of another variable; call the sample otherwise")
    count = len(names)
    listing.section(
        "the newest sample, and the model as soon as there are enough",
        "window",
        length=window.length,
        count=count,
        samples=names,
        last=window.length - 1,
        end=window.length * count,
        # where the numbers of a sample stand: so many places behind its number times a factor
        stride=count if window.by_sample else 1,
        places=[number if window.by_sample else number * window.length for number in range(count)],
        inputs=[port.name for port in block.inputs],
        outputs=[port.name for port in results],
    )
    what = " and ".join(names) if count <= 3 else f"{names[0]} .. {names[-1]}"
    header = header_lines(
        f"{block.name}{SUFFIX}: {block.name} on the last {window.length} samples of {what}",
        "Each call with bShift takes one sample, which takes the place of the oldest, and computes the outputs.",
        f"bValid is FALSE until {window.length} samples have come, and as long as the model has no answer.",
        "bReset forgets all samples, before one is taken. Without bShift all outputs stay.",
    )
    return Block(
        name=f"{block.name}{SUFFIX}",
        header=header,
        inputs=(
            *(BlockVariable(name, "LREAL", comment="number of the newest sample") for name in names),
            BlockVariable("bShift", "BOOL", comment="take a sample"),
            BlockVariable("bReset", "BOOL", comment="forget all samples"),
        ),
        outputs=(*results, BlockVariable("nSamples", "DINT", comment=f"samples that are kept, up to {window.length}")),
        variables=tuple(listing.variables.values()),
        sections=tuple(listing.sections),
    )
