"""Text of LLVM functions: values, blocks, and the traps that stop a run."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count

from st_codegen.st.check import arithmetic as a
from st_codegen.st.errors import Position, StRuntimeError
from st_codegen.st.types import BOOL, LREAL, REAL, Elementary, EnumType, PointerType, Scalar, Type, storage_type

#: What can stop a run; code refers to them by number.
KINDS = (
    a.DIVISION,
    a.INVALID,
    a.OVERFLOW,
    a.NAN_COMPARED,
    a.CONVERSION,
    a.INDEX,
    a.INTEGER_OVERFLOW,
    a.SHIFT,
    a.LOOP,
    a.STEP,
)
INFINITY = "0x7FF0000000000000"


@dataclass(frozen=True)
class Operand:
    """A value in the code, with its type."""

    code: str
    type: Elementary


@dataclass(frozen=True)
class Site:
    """A place in the text that can stop a run; `detail` is a format of the operands, empty for their list."""

    position: Position
    types: tuple[Elementary, ...]
    detail: str

    def error(self, kind: int, raw: Sequence[int], row: int) -> StRuntimeError:
        """What happened here, from the operands as 64 bits each."""
        operands = tuple(_decoded(bits, type_) for bits, type_ in zip(raw, self.types, strict=False))
        listed = f"operands {', '.join(map(repr, operands))}"
        detail = self.detail.format(*operands) if self.detail else listed
        return StRuntimeError(KINDS[kind], self.position, detail, row, operands)


def _decoded(bits: int, type_: Elementary) -> int | float | bool:
    raw = struct.pack("<q", bits)
    if type_ is BOOL:
        return bool(bits)
    if type_.is_real:
        value: float = struct.unpack("<d", raw)[0] if type_ is LREAL else struct.unpack("<f", raw[:4])[0]
        return value
    return int.from_bytes(raw[: type_.bits // 8], "little", signed=type_.is_signed)


def value_type(type_: Type) -> str:
    """The type of a value in a register; strings, structures, arrays and instances are addresses."""
    if isinstance(type_, EnumType):
        type_ = type_.base
    if not isinstance(type_, Elementary):
        return "ptr"
    if type_ is BOOL:
        return "i1"
    if type_.is_real:
        return "float" if type_ is REAL else "double"
    return f"i{type_.bits}" if type_.is_integral else "ptr"


def stored_type(type_: Type) -> str:
    """The type of a value in memory."""
    found = value_type(type_)
    return "i8" if found == "i1" else found


def number(value: float) -> str:
    """A real number as a constant."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


def literal(value: Scalar, type_: Type) -> str:
    """A constant of a type that lives in registers."""
    if isinstance(type_, PointerType):
        return "null"
    stored = storage_type(type_)
    if stored is BOOL:
        return "true" if value else "false"
    return number(float(value or 0)) if stored.is_real else str(int(value or 0))


class Writer:
    """Writes the body of one function; `functions` are the others that it may call, by name."""

    def __init__(self, sites: list[Site], functions: Mapping[str, str]) -> None:
        self.sites = sites
        self.functions = functions
        self.entry: list[str] = []
        self.lines: list[str] = []
        self._cold: list[str] = []
        self._numbers = count()

    # --- values ---

    def line(self, text: str) -> None:
        """Add an instruction without a result."""
        self.lines.append(f"  {text}")

    def value(self, text: str) -> str:
        """Add an instruction; gives the name of its result."""
        name = f"%t{next(self._numbers)}"
        self.lines.append(f"  {name} = {text}")
        return name

    def local(self, size: int) -> str:
        """Memory of the function, as an address."""
        name = f"%v{next(self._numbers)}"
        self.entry.append(f"  {name} = alloca [{size} x i8], align 8")
        return name

    def slot(self, type_: str) -> str:
        """Memory for one value that does not leave the function."""
        name = f"%v{next(self._numbers)}"
        self.entry.append(f"  {name} = alloca {type_}")
        return name

    def offset(self, base: str, offset: int) -> str:
        """An address some bytes further."""
        return base if not offset else self.value(f"getelementptr inbounds i8, ptr {base}, i64 {offset}")

    def load(self, type_: Type, address: str, is_constant: bool = False) -> str:
        """The value at an address."""
        suffix = ", !invariant.load !0" if is_constant else ""
        loaded = self.value(f"load {stored_type(type_)}, ptr {address}{suffix}")
        return self.value(f"icmp ne i8 {loaded}, 0") if value_type(type_) == "i1" else loaded

    def store(self, type_: Type, value: str, address: str) -> None:
        """Put a value at an address."""
        if value_type(type_) == "i1":
            value = self.value(f"zext i1 {value} to i8")
        self.line(f"store {stored_type(type_)} {value}, ptr {address}")

    def copy(self, target: str, source: str, size: int) -> None:
        """Copy memory that may overlap."""
        self.line(f"call void @llvm.memmove.p0.p0.i64(ptr {target}, ptr {source}, i64 {size}, i1 false)")

    def wide(self, operand: Operand) -> str:
        """An integer in 64 bits."""
        if operand.type.bits == 64:
            return operand.code
        word = "sext" if operand.type.is_signed else "zext"
        return self.value(f"{word} {value_type(operand.type)} {operand.code} to i64")

    # --- blocks ---

    def label(self) -> str:
        """A new name of a block."""
        return f"b{next(self._numbers)}"

    def begin(self, label: str) -> None:
        """What follows is a block of its own."""
        self.lines.append(f"{label}:")

    def jump(self, label: str) -> None:
        """End the block; what follows is not reached unless another begins."""
        self.line(f"br label %{label}")

    def branch(self, condition: str, then: str, otherwise: str) -> None:
        """End the block by a choice."""
        self.line(f"br i1 {condition}, label %{then}, label %{otherwise}")

    def leave(self, label: str) -> None:
        """Jump where the text has a statement that leaves; what stands behind it cannot be reached."""
        self.jump(label)
        self.begin(self.label())

    # --- traps ---

    def trap(
        self, condition: str, kind: str, position: Position, operands: Sequence[Operand], detail: str = ""
    ) -> None:
        """Stop the run where a condition holds."""
        bad, good = self.label(), self.label()
        self.branch(condition, bad, good)
        self.begin(good)
        lines: list[str] = []
        bits = [self._bits(operand, lines) for operand in operands] + ["0", "0"]
        site = self.site(position, operands, detail)
        arguments = f"ptr %c, i64 {KINDS.index(kind)}, i64 {site}, i64 {bits[0]}, i64 {bits[1]}"
        fault = f"  call void {self.functions['fault']}({arguments}) #0"
        self._cold += [f"{bad}:", *lines, fault, "  br label %fail"]

    def site(self, position: Position, operands: Sequence[Operand], detail: str = "") -> int:
        """The number of a place that can stop a run."""
        self.sites.append(Site(position, tuple(operand.type for operand in operands), detail))
        return len(self.sites) - 1

    def _bits(self, operand: Operand, lines: list[str]) -> str:
        def cold(text: str) -> str:
            name = f"%t{next(self._numbers)}"
            lines.append(f"  {name} = {text}")
            return name

        code, type_ = operand.code, operand.type
        if type_.is_real:
            code = cold(f"bitcast {value_type(type_)} {code} to i{type_.bits}")
        size = 1 if type_ is BOOL else type_.bits
        return code if size == 64 else cold(f"{'sext' if type_.is_signed else 'zext'} i{size} {code} to i64")

    def trap_if_called(self, condition: str, function: str, arguments: str) -> None:
        """Where a condition holds, call a function of the prelude that knows whether this stops the run."""
        bad, good = self.label(), self.label()
        self.branch(condition, bad, good)
        self.begin(good)
        stops = f"%t{next(self._numbers)}"
        self._cold += [
            f"{bad}:",
            f"  {stops} = call i1 {self.functions[function]}({arguments}) #0",
            f"  br i1 {stops}, label %fail, label %{good}",
        ]

    def propagate(self, status: str) -> None:
        """Go on only if a called unit was not stopped."""
        failed = self.value(f"icmp ne i32 {status}, 0")
        good = self.label()
        self.branch(failed, "fail", good)
        self.begin(good)

    def body(self) -> list[str]:
        """All lines of the function's body."""
        return ["entry:", *self.entry, *self.lines, *self._cold, "fail:", "  ret i32 1"]
