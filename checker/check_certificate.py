"""Checks a certificate of `st-codegen prove` against the model files and the generated text, sharing no code with it.

    python checker/check_certificate.py CERTIFICATE MODELS OUT
        exit 0: every entry is confirmed; 1: rejected; 2: wrong use; 3: some entries are not checked here

Needs NumPy and the standard library. docs/proof.md explains why what is done here is a proof, and what is outside.
"""

import ast
import functools
import hashlib
import json
import keyword
import re
import sys
import tomllib
from itertools import product
from pathlib import Path

import numpy as np
from model_files import HIGH, LOW, Reject, bits, keys, need, numbers, read_model, single

#: How the names of model files end.
KINDS = {".txt", ".json", ".ubj", ".skops", ".onnx", ".joblib", ".pkl"}
#: What a file that is not as it should be may raise.
REJECTIONS = (Reject, OSError, ValueError, LookupError, TypeError, AttributeError, OverflowError, SyntaxError)
#: In about so many boxes of whole trees a text is executed at once.
BOXES = 100_000

# --- Structured Text ------------------------------------------------------------------------------------------------
WORDS = {
    ":=": "=",
    "=": "==",
    "<>": "!=",
    "AND": "and",
    "OR": "or",
    "NOT": "~",
    "MOD": "%",
    "TRUE": "True",
    "FALSE": "False",
    "EXIT": "break",
}
KNOWN = {*"+-*/()[],<>", "<=", ">="}
TOKEN = re.compile(r"\s*((?:\w+#)?16#[0-9A-Fa-f_]+|\d+\.\d+(?:E[-+]?\d+)?|\d+|[A-Za-z_]\w*|:=|<=|>=|<>|\S)")


def translated(code):
    """Statements as the syntax tree of the Python statements of the same shape."""
    lines, words, depth, loop = [], [], 0, False
    for token in TOKEN.findall(code):
        if token in ("THEN", "DO", "ELSE", ";"):
            text, words = " ".join(words), []
            if token == "DO":
                form = re.fullmatch(r"(\w+) = (.*?) TO (.*?)(?: BY (.*))?", text)
                need(loop and form, f"the loop {text}")
                text = f"for {form[1]} in loop({form[2]}, {form[3]}, {form[4] or 1}):"
            if text not in ("END_IF", "END_FOR"):
                need(token != "ELSE" or not text, "ELSE in a statement")
                text = "else:" if token == "ELSE" else text + (":" if token == "THEN" else "")
                lines.append(" " * (depth - (text[:4] in ("elif", "else"))) + text)
            depth += token in ("DO",) or (token == "THEN" and text[:2] == "if")
            loop = False
        elif token in ("END_IF", "END_FOR"):
            need(not words, f"{token} in a statement")
            depth, words = depth - 1, [token]
        elif token in ("IF", "ELSIF"):
            words.append({"IF": "if", "ELSIF": "elif"}[token])
        elif token == "FOR":
            loop = True
        else:
            plain = token[0].isalnum() and not keyword.iskeyword(token)
            need(plain or token in WORDS or token in KNOWN, f"'{token}', which is a word of Python or not known")
            if "16#" in token:
                need(token[:3] == "16#" or (token[:6] == "DWORD#" and words[-1:] == ["and"]), f"the type of {token}")
                words.append(str(int(token.split("16#")[1].replace("_", ""), 16)))
            else:
                words.append(WORDS.get(token, token))
    need(not words, "the text ends in a statement")
    return ast.parse("\n".join(lines)).body


#: The signs of a file: ASCII, and no end of a line that is one for some compilers only.
SIGNS = re.compile(r"[\t\n -~]*")
#: Comments, strings and attributes as they are generated: every compiler ends them at the same place, and none of them
#: changes what the text does.
PIECE = re.compile(
    r"\(\*(?=\s)(?:(?!\(\*|\*\)|/\*|\*/).)*(?<=\s)\*\)|'[][\w ,.:-]*'"
    r"|\{attribute '(?:hide|linkalways|no_check|qualified_only|strict)'\}",
    re.S,
)
#: Signs of all others.
OTHER_PIECE = re.compile(r"""['"{}]|//|/\*|\*/|\(\*|\*\)""")
#: A file of TwinCAT: the name of its one unit or list of variables, and the text.
OBJECT = re.compile(
    r'<\?xml version="1\.0" encoding="utf-8"\?>\s*<TcPlcObject Version="[\d.]+"(?: ProductVersion="[\d.]+")?>\s*'
    r'<(POU|DUT|GVL) Name="(\w+)" Id="\{[\w-]+\}"(?: SpecialFunc="None")?>\s*'
    r"<Declaration><!\[CDATA\[(.*?)\]\]></Declaration>\s*"
    r"(?:<Implementation>\s*<ST><!\[CDATA\[(.*?)\]\]></ST>\s*</Implementation>\s*)?</\1>\s*</TcPlcObject>\s*",
    re.S,
)
UNITS = {"FUNCTION", "FUNCTION_BLOCK", "TYPE"}
#: What stands in front of a call in an expression.
CALLING = {*"+-*/<>=(,[", ":=", "AND", "OR", "XOR", "NOT", "MOD", "IF", "ELSIF", "TO", "BY"}


def uncommented(text, name):
    """Structured Text without comments; of strings and attributes their first sign is left.

    What is not generated so is rejected: compilers may disagree on where it ends, or on what it does.
    """
    other = OTHER_PIECE.search(PIECE.sub(" ", text))
    need(not other, f"{name}: {other and other[0]!r}; comments, strings or pragmas are read as they are generated only")
    return PIECE.sub(lambda piece: piece[0][0].replace("(", " "), text)


def code_of(path):
    """The Structured Text of a file without comments; in front of a list of variables stands its name."""
    text = path.read_bytes().decode("utf-8-sig").replace("\r\n", "\n")
    need(SIGNS.fullmatch(text), f"{path.name}: a sign that is not ASCII, or ends a line for some compilers only")
    if path.suffix.lower() == ".st":
        return uncommented(text, path.name)
    form = OBJECT.fullmatch(text)
    need(form and "]]>" not in form[3] + (form[4] or ""), f"{path.name}: another form of file, or several units")
    text = "\n".join(uncommented(part or "", path.name) for part in form.groups()[2:])
    if form[1] == "GVL":
        return f"{form[2]}\n{text}"
    unit = re.match(r"[\s{]*(?:FUNCTION|FUNCTION_BLOCK|PROGRAM|TYPE)\s+(\w+)", text)
    need(unit and unit[1] == form[2], f"{path.name}: a unit of another name")
    need(not re.search(r"\bEND_(?:FUNCTION|PROGRAM)", text, re.I), f"{path.name}: a unit that ends in its text")
    return text


def codes(folder, block):
    """The Structured Text of all files of a target, without comments. The names that a block needs have one meaning.

    Wherever such a name stands, it is used: types behind a colon, functions in calls. No file can declare it anew.
    """
    paths = [path for path in sorted(folder.rglob("*")) if path.suffix.lower() in READ]
    need(len({path.suffix.lower() == ".st" for path in paths}) < 2, "texts of two kinds, of which one may be imported")
    found = [code_of(path) for path in paths]
    every = re.sub(r"\[[-+\d.E,\s]*\]", "[]", "\n".join(found).upper())  # lists of numbers
    words = [word for word in re.findall(r"\w+|:=|\S", every) if word != "{"]
    own, units = {block.upper(), "F_ISNAN", "U_LREALBITS"}, []
    for before, word, after in zip(["", *words], words, [*words[1:], ""], strict=False):
        if word in TYPES:
            used = after == "#" or (before in (":", "OF", ")") and after in (";", ":=", "VAR_INPUT"))
        elif word in FUNCTIONS | own:
            used = after == "(" and before in CALLING
            if word in own:
                units += [word] * (before in UNITS)
                result = word == "F_ISNAN" and (before, after) == (";", ":=")
                used = used or result or before in UNITS or (before in (":", "OF") and after == ";")
        else:
            continue
        need(used, f"'{before} {word} {after}' may give {word} another meaning")
    need(len(set(units)) == len(units), "two units of one name")
    return found


def literal(word, real):
    """The number of a literal of digits: no names, no underscores, nothing beyond the largest number."""
    need(re.fullmatch(r"-?\d+(\.\d+(E[-+]?\d+)?)?", word, re.A), f"the number {word}")
    number = float(word) if real else int(word)
    need(abs(number) < np.inf, f"{word} overflows")
    return number


def read_block(texts, name):
    """Inputs, outputs, constants, initial values and statements of a function block."""
    another = r"\s*(?:(?:FUNCTION|FUNCTION_BLOCK|PROGRAM|TYPE|CONFIGURATION)\b|\Z)"
    form = rf"^FUNCTION_BLOCK {name}$(.*?)(?:^END_FUNCTION_BLOCK\b(?={another})|\Z)"
    parts = [part for text in texts for part in re.findall(form, text, re.S | re.M | re.I)]
    need(len(parts) == 1, f"{len(parts)} blocks {name}")
    text = parts[0]
    need(not re.search(r"[{'^]", text), "attributes, strings or pointers")
    ports, constants, values, end = {"VAR_INPUT": [], "VAR_OUTPUT": []}, {}, {}, 0
    for section in re.finditer(r"\s*(VAR\w*)( CONSTANT)?\s(.*?)END_VAR", text, re.S):
        need(section.start() == end and section[1] in ("VAR", *ports), "text between declarations, or another section")
        need(section[1] == "VAR" or not section[2], "constant inputs or outputs")
        end = section.end()
        for line in filter(None, map(str.strip, section[3].split(";"))):
            form = re.fullmatch(
                r"(\w+) : (?:ARRAY\[0\.\.(\d+)\] OF )?(LREAL|[SD]?INT|BOOL|DWORD)(?:\s*:=\s*(.*))?", line, re.S
            )
            known = {"f_isnan", "true", "false", *map(str.lower, values)}
            need(form and form[1].lower() not in known, f"the declaration {line[:60]}")
            size, given = int(form[2] or 0) + 1, form[4] or ""
            given = re.sub(r"\b(?:DWORD#)?16#(\w+)", lambda m: str(int(m[1], 16)), given)
            kind = {"LREAL": np.float64, "BOOL": np.bool_, "SINT": np.int8, "INT": np.int16}.get(form[3], np.int32)
            need(not (given and kind is np.bool_), "an initial truth value")
            need(section[2] or form[3] not in ("SINT", "INT", "DWORD"), "a variable of a narrow type, or of bits")
            need(section[1] != "VAR_INPUT" or form[3] == "LREAL", "an input that is no LREAL")
            need(form[3] != "DWORD" or not form[2], "a list of bits")
            words = given.strip("[] \n").split(",") if given else ["0"] * size
            need(len(words) == size, f"{form[1]}: another number of elements")
            items = np.array([literal(word.strip(), kind is np.float64) for word in words], kind)  # OverflowError
            items = items.astype(np.int64) if kind is np.int32 else items
            values[form[1]] = (items if section[2] else items.tolist()) if form[2] else items[0].item()
            constants |= {form[1]: form[3]} if section[2] else {}
            ports.get(section[1], []).append(form[1])
    need("VAR" not in text[end:].split(), "declarations behind statements")
    return *ports.values(), constants, values, translated(text[end:])


# --- executing the text on many boxes of inputs at once ---------------------------------------------------------------
class V:
    """What a value may be in each box: from `a[0]` to `a[1]` in the order of `keys`, or anything where `u` is set.

    Truth values that are not decided have `u` set.

    `raw`: computed from the number of an input, and not chosen from numbers of the text.
    """

    def __init__(self, a, u, raw=False):
        self.a, self.u, self.raw = a, u, raw

    @property
    def exact(self):
        """Where it is one value, bit for bit."""
        return ~self.u & (bits(self.a[0]) == bits(self.a[1]))

    def is_number(self, number):
        """Whether it is this number in all boxes."""
        return bool(np.all(self.exact & (bits(self.a[0].astype(float)) == bits(number))))

    def surely(self, truth):
        return ~self.u & (self.a[0] == truth)


class Sum:
    """An expression of what trees give: `key` is its shape, with the numbers of the terms in `Machine.terms`."""

    def __init__(self, key):
        self.key = key


def kind(value):
    """The type of a value: float, int or bool."""
    value = value.a if isinstance(value, V) else 0.0 if isinstance(value, Sum) else value
    return {"f": float, "i": int, "b": bool}[value.dtype.kind] if isinstance(value, np.ndarray) else type(value)


COMPARE = {ast.Lt: np.less, ast.LtE: np.less_equal, ast.Gt: np.greater, ast.GtE: np.greater_equal}
#: All are monotone in each operand, so that the ends of the operands have the ends of the result among their results.
NUMERIC = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "MIN": np.minimum,
    "MAX": np.maximum,
    "ABS": np.abs,
    "NEG": np.negative,
    "LREAL_TO_REAL": single,
}
#: From what type to what.
CONVERSIONS = {"DINT_TO_LREAL": (int, np.float64), "BOOL_TO_DINT": (bool, np.int64), "TRUNC": (float, np.int64)}
NARROW = {"SINT_TO_DINT": np.int8, "INT_TO_DINT": np.int16}
#: Types that no text may define anew, and functions, whose names stand in calls only.
TYPES = {"LREAL", "REAL", "DINT", "INT", "SINT", "BOOL", "DWORD", "LWORD"}
FUNCTIONS = NUMERIC.keys() - {*"+-*/", "NEG"} | CONVERSIONS.keys() | NARROW.keys()
FUNCTIONS |= {"DINT_TO_DWORD", "DWORD_TO_DINT", "REAL_TO_LREAL"}


class Machine:
    """One call of a block in all boxes; at the numbers in `covers` begins each cover of all inputs.

    The boxes of one cover hold all inputs together: what is sure in each of them is sure. So an operation is `owed`
    where it is executed, and `paid` where it cannot fail in any box of one cover. `known` gives elements of lists that
    are functions of one input what they are in the boxes; in `never` are conditions that no input meets that the model
    takes, and `taken` says which boxes have such inputs only.
    """

    def __init__(self, block, inputs, covers, has_isnan, taken=None, known=None, never=()):
        self.inputs, self.outputs, self.constants, values, self.statements = block
        self.n, self.covers, self.has_isnan, self.taken = len(inputs[0].u), covers, has_isnan, taken
        self.known, self.never, self.path = known or {}, set(never), ()
        self.owed, self.paid, self.terms, self.cuts, self.quotients, self.lists = {}, set(), [], [], [], {}
        self.sums = []  # all operations on what trees give
        self.values = {k: list(v) if isinstance(v, list) else v for k, v in values.items()}
        self.kinds = {name: kind(v[0] if isinstance(v, list) else v) for name, v in values.items()}
        self.assigned, self.early = {(i, 0) for i in self.inputs}, set()
        need(len(self.inputs) == len(inputs), "another number of inputs")
        self.values |= dict(zip(self.inputs, inputs))
        self.block(self.statements, True)
        need(not self.early & self.assigned, "a variable is read before it is assigned")

    def owe(self, e, reason, fine, mask):
        """An operation that must not fail: `fine` says in which boxes it does not."""
        key = id(e), self.path, reason
        self.owed[key] = reason
        if self.everywhere(fine if mask is True else fine | mask.surely(False)):
            self.paid.add(key)

    def everywhere(self, fine):
        """Whether something holds in all boxes of a cover."""
        return bool(np.all(fine) or np.any(np.logical_and.reduceat(fine, self.covers)))

    def wide(self, v):
        need(isinstance(v, V | bool | int | float), "a sum of trees where a number is needed")
        return v if isinstance(v, V) else V(np.full((2, self.n), v), np.zeros(self.n, bool))

    def block(self, statements, mask):
        left = False  # where a loop was left
        for s in statements:
            gone = False
            if isinstance(s, ast.Assign):
                need(len(s.targets) == 1, "two assignments in one")
                self.assign(s.targets[0], self.value(s.value, mask), mask)
            elif isinstance(s, ast.Break):
                gone = mask
            elif judges(s):
                names = {n.id for n in ast.walk(s) if isinstance(n, ast.Name)}
                need("bPlausible" in self.outputs and names <= {*self.outputs, *self.constants}, "bPlausible")
            elif isinstance(s, ast.If):
                test, key = self.value(s.test, mask), (id(s), self.path)
                if isinstance(test, Sum):
                    self.choose(s, test, mask)
                    continue
                test = False if key in self.never else test
                if self.taken is not None and isinstance(test, V) and self.everywhere(test.surely(False) | ~self.taken):
                    self.never.add(key)
                yes, no = self.both(mask, test), self.both(mask, self.opposite(test))
                for body, where in ((s.body, yes), (s.orelse, no)):
                    if body and where is not False:
                        gone = self.either(gone, self.block(body, where))
            else:
                gone = self.loop(s, mask)
            left = self.either(left, gone)
            mask = self.both(mask, self.opposite(gone))
            if mask is False:
                break
        return left

    def loop(self, s, mask):
        need(isinstance(s, ast.For), "a statement of another kind")
        first, last, step = (self.value(a, mask) for a in s.iter.args)
        need(all(type(b) is int for b in (first, last, step)) and step > 0, "a loop whose bounds depend on the inputs")
        need(last + step < 2**31 and first != last, "a loop that never ends, or whose round a compiler leaves out")
        stores = {
            n.id for part in s.body for n in ast.walk(part) if isinstance(n, ast.Name) and type(n.ctx) is ast.Store
        }
        read = {n.id for part in s.iter.args for n in ast.walk(part) if isinstance(n, ast.Name)}
        need(s.target.id not in stores, "a counter that its loop assigns")
        need(read <= self.constants.keys(), "a loop whose bounds may change in it")
        outside = self.path
        for counter in range(first, last + 1, step):
            self.path = (*outside, counter)
            self.assign(s.target, counter, True)
            mask = self.both(mask, self.opposite(self.block(s.body, mask)))
            if mask is False:
                break
        self.path, self.values[s.target.id] = outside, None
        return False

    def choose(self, s, test, mask):
        """Assignments under a condition on sums: both values are kept."""
        need(mask is True and not s.orelse and all(isinstance(part, ast.Assign) for part in s.body), "a condition")
        for part in s.body:
            new, old = (self.term(self.value(e, True)) for e in (part.value, part.targets[0]))
            self.assign(part.targets[0], Sum(("if", test.key, new, old)), True)

    def assign(self, target, new, mask):
        array = isinstance(target, ast.Subscript)
        name, place = (target.value.id, self.value(target.slice, mask)) if array else (target.id, 0)
        need(name in self.values and name not in self.constants and name not in self.inputs, f"{name} is assigned")
        need(name not in self.outputs or (name, place) not in self.assigned, f"{name} is assigned twice")
        need(type(place) is int and (not array or 0 <= place < len(self.values[name])), f"{name}: an index")
        old = self.values[name][place] if array else self.values[name]
        fits = (
            is_label(new.key) or self.kinds[name] is not int if isinstance(new, Sum) else kind(new) is self.kinds[name]
        )
        need(fits, f"{name}: a value of another type")
        if mask is not True and name in self.outputs:
            new = ("if", mask, new)
        elif mask is not True:
            before = (name, place) in self.assigned and not isinstance(old, Sum)
            new = self.joined(mask, self.wide(new), self.wide(old) if before else None)
        if array and isinstance(new, V):
            key = id(target), self.path
            if key in self.known:
                table, first, last = self.known[key]
                a = np.array([table[0][first], table[1][last]])
                new = V(a, (a[0] != a[1]) & (a.dtype == bool), new.raw)
            if self.taken is not None and np.any(np.logical_and.reduceat(~new.u, self.covers)):
                self.lists[key] = new
        if array:
            self.values[name][place] = new
        else:
            self.values[name] = new
        self.assigned.add((name, place))

    def joined(self, mask, new, old):
        """A new value where the mask is true, the old one where it is false; if neither is sure, both must be equal."""
        old = old or V(new.a, np.ones(self.n, bool))  # from an earlier call
        on, off = mask.surely(True), mask.surely(False)
        open_ = ~on & ~off & (new.u | old.u | np.any(bits(new.a) != bits(old.a), axis=0))
        unknown = open_ | np.where(off, old.u, new.u)
        return V(np.where(off, old.a, new.a), unknown, new.raw or old.raw)

    def both(self, a, b):
        need(kind(a) is kind(b) is bool, "a number as a condition")
        for one, other in ((a, b), (b, a)):
            if isinstance(one, bool):
                return other if one else False
        unknown = (a.u | b.u) & ~a.surely(False) & ~b.surely(False)
        out = V(a.a & b.a & ~unknown, unknown)
        return out if np.any(out.a[0] | unknown) else False

    def either(self, a, b):
        return self.opposite(self.both(self.opposite(a), self.opposite(b)))

    def opposite(self, v):
        return not v if isinstance(v, bool) else V(~v.a.astype(bool), v.u)

    def value(self, e, mask):
        if isinstance(e, ast.Constant):
            need(isinstance(e.value, bool) or abs(e.value) < (2**31 if type(e.value) is int else np.inf), "a number")
            return e.value
        if isinstance(e, ast.Name):
            need(self.constants.get(e.id) != "DWORD", f"{e.id}: bits as a number")
            return self.read(e.id, 0, self.values.get(e.id))
        if isinstance(e, ast.Subscript):
            return self.element(e, self.value(e.slice, mask), mask)
        if isinstance(e, ast.BoolOp):
            if not self.has_isnan and (place := tested(e)) is not None:
                return self.opposite(self.is_nan(self.value(place, mask)))
            how = self.both if isinstance(e.op, ast.And) else self.either
            return functools.reduce(how, [self.value(v, mask) for v in e.values])
        if isinstance(e, ast.UnaryOp):
            inner, name = self.value(e.operand, mask), {ast.Invert: "NOT", ast.USub: "NEG"}[type(e.op)]
            need(name != "NOT" or kind(inner) is bool, "NOT of a number")
            return self.opposite(inner) if name == "NOT" else self.number(e, name, [inner], mask)
        if isinstance(e, ast.BinOp):
            name = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}[type(e.op)]
            return self.number(e, name, [self.value(e.left, mask), self.value(e.right, mask)], mask)
        if isinstance(e, ast.Compare):
            need(len(e.ops) == 1, "comparisons in a row")
            a, b, how = self.value(e.left, mask), self.value(e.comparators[0], mask), type(e.ops[0])
            if how in COMPARE:
                return self.compare(e, COMPARE[how], a, b, mask)
            same = self.both(*(self.compare(e, one, a, b, mask) for one in (np.less_equal, np.greater_equal)))
            return same if how is ast.Eq else self.opposite(same)
        return self.call(e, mask)

    def call(self, e, mask):
        name, inner = e.func.id, e.args[0]
        need(not e.keywords and len(e.args) == 1 + (name in ("MIN", "MAX")), f"the arguments of {name}")
        if name == "REAL_TO_LREAL":  # arithmetic in REAL, or with literals that may be REAL, is not known
            need(isinstance(inner, ast.Call) and inner.func.id == "LREAL_TO_REAL", "a REAL that was not just made")
            return self.number(inner, "LREAL_TO_REAL", [self.value(inner.args[0], mask)], mask)
        if name in NARROW:  # arithmetic on narrow integers may overflow: they are read as DINT only
            need(isinstance(inner, ast.Subscript), "a narrow number that is computed")
            need(self.values[inner.value.id].dtype == NARROW[name], "an element of another type")
            return self.element(inner, self.value(inner.slice, mask), mask, narrow=True)
        if name == "DWORD_TO_DINT":
            need(isinstance(inner, ast.BoolOp) and isinstance(inner.op, ast.And), "bits")
            number, mask_ = inner.values
            a, b = self.wide(self.value(number.args[0], mask)), getattr(mask_, "value", None)
            b = self.values[mask_.id] if isinstance(mask_, ast.Name) and mask_.id in self.constants else b
            need(number.func.id == "DINT_TO_DWORD" and type(b) is int and 0 <= b < 2**31, "bits")
            return V(a.a & b, ~a.exact)
        values = [self.value(a, mask) for a in e.args]
        if name == "F_IsNan":
            need(self.has_isnan, "F_IsNan is another function")
            return self.is_nan(values[0])
        if name in CONVERSIONS:
            return self.converted(e, name, values[0], mask)
        need(name in ("ABS", "MIN", "MAX"), f"the function {name}")
        return self.number(e, name, values, mask)

    def converted(self, e, name, v, mask):
        """A number in another type. Of expressions only labels are cut to integers: a choice of whole numbers."""
        if isinstance(v, Sum):
            need(name != "TRUNC" or is_label(v.key), "TRUNC of a sum")
            return v
        need(kind(v) is CONVERSIONS[name][0], f"{name} of another type")
        v = self.wide(v)
        fits = np.all(np.abs(v.a) < 2.0**31, axis=0) if name == "TRUNC" else np.full(self.n, True)
        self.owe(e, "TRUNC of what is too large", fits & ~v.u, mask)
        return V(np.where(fits, v.a, 0).astype(CONVERSIONS[name][1]), v.u | ~fits, v.raw)

    def read(self, name, place, value):
        need(value is not None and name not in self.outputs, f"{name} is read")
        if name not in self.constants and (name, place) not in self.assigned:
            self.early.add((name, place))  # its initial value, which nothing may change
        return value

    def element(self, e, index, mask, *, narrow=False):
        name, table = e.value.id, self.values[e.value.id]
        need(kind(index) is int, "an index that is no whole number")
        if isinstance(table, np.ndarray):
            need(narrow == (table.dtype.itemsize < 8), f"{name}: a narrow number that is not converted")
        if type(index) is int:
            need(0 <= index < len(table), "an index out of range")
            return self.read(name, index, table[index] if isinstance(table, list) else table[index].item())
        inside = ~index.u & (index.a[0] >= 0) & (index.a[1] < len(table))
        self.owe(e, "an index out of range", inside, mask)
        sure = inside & index.exact
        at = np.where(sure, index.a[0], 0)
        if isinstance(table, np.ndarray):
            found = np.array([table[at]] * 2, np.int64 if narrow else None)
            if self.known and kind(found) is int:  # somewhere in the table: between its least and its largest number
                found[:, inside & ~sure] = [[np.min(table)], [np.max(table)]]
                sure = inside
            return V(found, ~sure)
        items = {p: self.wide(self.read(name, p, table[p])) for p in np.unique(at[sure]).tolist()}
        out = V(np.zeros((2, self.n), self.kinds[name]), ~sure)
        for p, item in items.items():
            here = sure & (at == p)
            out = V(np.where(here, item.a, out.a), np.where(here, item.u, out.u), out.raw or item.raw)
        return out

    def number(self, e, name, values, mask):
        floats = kind(values[0]) is float
        need({kind(v) for v in values} in ({int}, {float}), f"{name} of different types")
        chosen = [v for v in values if isinstance(v, V) and not v.raw]
        if any(isinstance(v, Sum) for v in values) or (floats and name in ("+", "MIN", "MAX") and chosen):
            self.sums.append((name, *(self.term(v) for v in values)))
            return Sum(self.sums[-1])
        if name == "/" and not floats:
            return self.quotient(e, *values, mask)
        need(name != "/" or not isinstance(values[1], V), "a division by an input")
        return self.computed(e, name, values, floats, mask)

    def computed(self, e, name, values, floats, mask):
        """The ends of a result from all ends of its operands."""
        wide, kind = [v for v in values if isinstance(v, V)], float if floats else int
        ends = [v.a if isinstance(v, V) else [kind(v)] for v in values]
        with np.errstate(all="ignore"):
            outs = np.array([NUMERIC[name](*sides) for sides in product(*ends)])
        if not wide:
            need(np.isfinite(outs[0]) if floats else abs(outs[0]) < 2**31, "a constant that overflows")
            return kind(outs[0])
        if floats:
            infinite = np.any([np.any(np.isinf(v.a), axis=0) for v in wide], axis=0)
            fits, order = np.all(np.isfinite(outs) | (np.isinf(outs) & infinite), axis=0), keys(outs)
        else:
            fits, order = np.all(np.abs(outs) < 2**31, axis=0), outs
        unknown = np.any([v.u for v in wide], axis=0)
        self.owe(e, f"{name} can overflow or meet NaN", fits & ~unknown, mask)
        out = np.array([np.min(order, axis=0), np.max(order, axis=0)])
        crossed = (wide[0].a[0] < 0) & (wide[0].a[1] > 0) if name == "ABS" else False
        return V(numbers(out) if floats else out, unknown | ~fits | crossed, any(v.raw for v in wide))

    def quotient(self, e, a, b, mask):
        """A whole number from 0 on by a constant, which rises with it."""
        need(type(b) is int and b > 0, "a division by a number that is no constant above 0")
        a = self.wide(a)
        fine = (a.a[0] >= 0) & ~a.u
        self.owe(e, "a division of a number below 0", fine, mask)
        self.quotients.append(V(np.where(fine, a.a, 0) // b, ~fine))
        return self.quotients[-1]

    def term(self, v):
        if isinstance(v, Sum):
            return v.key
        if isinstance(v, V):
            self.terms.append(v)
            return ("term", len(self.terms) - 1)
        return ("const", float(v).hex())

    def is_nan(self, v):
        need(isinstance(v, V), "a test for NaN of a computed number")
        nan = np.isnan(v.a)
        return V(nan, v.u | (nan[0] != nan[1]))

    def compare(self, e, how, a, b, mask):
        need(kind(a) is kind(b), "a comparison of different types")
        if isinstance(a, Sum) or isinstance(b, Sum):
            return Sum((how.__name__, self.term(a), self.term(b)))
        if not isinstance(a, V) and not isinstance(b, V):
            return bool(how(a, b))
        a, b = self.wide(a), self.wide(b)
        unknown = a.u | b.u
        self.owe(e, "a comparison with NaN", ~unknown & ~np.any(np.isnan(a.a) | np.isnan(b.a), axis=0), mask)
        out = np.array([how(a.a[0], b.a[1]), how(a.a[1], b.a[0])])
        differ = ~unknown & (out[0] != out[1])
        if np.any(differ):
            self.cuts.append((np.flatnonzero(differ), (b if a.raw else a).a[:, differ]))
        return V(out, unknown | differ)


#: What a comparison of outputs with constants is made of, which cannot fail: outputs are never NaN.
JUDGING = (ast.BoolOp, ast.Or, ast.Compare, ast.Lt, ast.Gt, ast.Name, ast.Load, ast.Constant, ast.UnaryOp, ast.USub)


def judges(s):
    """Whether a statement only sets bPlausible to FALSE where outputs lie outside a range; of it nothing is claimed."""
    if not isinstance(s, ast.If) or s.orelse or len(s.body) != 1 or not isinstance(s.body[0], ast.Assign):
        return False
    target, value = s.body[0].targets[0], s.body[0].value
    plain = isinstance(target, ast.Name) and target.id == "bPlausible"
    plain &= isinstance(value, ast.Constant) and value.value is False
    return plain and all(isinstance(node, JUDGING) for node in ast.walk(s.test))


def is_label(key):
    """Whether an expression chooses between small whole numbers."""
    if key[0] == "if":
        return is_label(key[2]) and is_label(key[3])
    return key[0] == "const" and float.fromhex(key[1]) in range(1 << 15)


#: What counts the calls since the outputs were valid, of which nothing is claimed; it cannot fail.
AGE = "if bUsable:\n    nAge = 0\nelif nAge < 2147483647:\n    nAge = nAge + 1"


# --- the check --------------------------------------------------------------------------------------------------------
class Check:
    """One model against the outputs of a block that the certificate names; `others` are those of other models.

    `called` are the names of the block's inputs, in the order of the model's; else the features' own.
    """

    def __init__(self, model, folder, entry, others=(), called=()):
        model.prepare()
        self.made, self.forms, self.entry = {}, {}, entry
        texts = codes(folder, entry["block"])
        self.model, self.block, self.has_isnan = model, read_block(texts, entry["block"]), has_isnan(folder, texts)
        self.ends, ports = [], [name.lower() for name in self.block[0]]
        numbers_ = [name for name in self.block[1] if not isinstance(self.block[3][name], bool)]
        counts = {"nAge"} - set(entry["outputs"])
        *before, last = self.block[4]
        if counts < set(numbers_) and type(self.block[3]["nAge"]) is int and ast.unparse(last) == AGE:
            self.block = (*self.block[:4], before)
        mine = [name for name in numbers_ if name not in counts | set(others)]
        need(mine == entry["outputs"] and "bValid" in self.block[1], "other outputs than the block's")
        called = [name.lower() for name in called or usual(entry["inputs"])]
        for f, port in enumerate(called):
            need(port not in ports or ports.index(port) == f, "inputs in another order")
            inner = [last[t[0] == f] for t, last in zip(model.trees, model.last)]
            edges = keys([model.lower[f], model.upper[f]])
            ends = [model.first_key[f] - 1, model.last_key[f], LOW, HIGH - 1, -2, -1, 0, HIGH]
            self.ends.append(np.unique(np.concatenate([*inner, edges - 1, edges, ends])))
        machine = self.alone()
        self.valid(machine)
        self.paid, self.known = machine.paid, dict(self.rising(machine))
        self.steps = list(self.changes(machine))
        need(len(entry["outputs"]) == (1 if model.label else len(model.base)), "another number of outputs")
        terms = [(t[5][:, c]) for t in model.trees for c in range(len(t[6]))]
        self.trees = sum(bool(np.any(bits(v) != bits(v[:1]))) for v in terms)
        sums = any(isinstance(value, Sum) for _, value in self.results(machine))
        self.method = (BY_CLASS if model.label else "sums of trees, tree by tree") if sums else "all cells"
        self.sums() if sums else self.cells()
        for key, reason in machine.owed.items():
            need(key in self.paid, f"{reason}: not decided in the boxes of any tree")

    def results(self, machine):
        """For each output where it is assigned, and what."""
        for name in self.entry["outputs"]:
            need((name, 0) in machine.assigned, f"{name} is not assigned")
            value = machine.values[name]
            yield value[1:] if isinstance(value, tuple) else (True, value)

    def lanes(self, f):
        """Keys of the first and last number of each interval of an input, NaN behind them; which the model takes."""
        ends = self.ends[f] = self.ends[f][(self.ends[f] >= LOW) & (self.ends[f] <= HIGH)]
        starts = np.append(LOW, ends[:-1] + 1)
        taken = np.append((starts >= self.model.first_key[f]) & (ends <= self.model.last_key[f]), self.model.nan)
        return np.array([np.append(numbers(k), np.nan) for k in (starts, ends)]), taken

    def alone(self):
        """Each input varies while the others are anything; intervals are cut until every comparison is decided."""
        for _ in range(64):
            sides, taken = zip(*map(self.lanes, range(self.model.features)))
            count = [len(part) for part in taken]
            owner, self.first = np.repeat(np.arange(len(count)), count), np.cumsum([0, *count])
            every = np.concatenate(sides, axis=1)
            inputs = [V(every, owner != f, raw=True) for f in range(len(count))]
            machine = Machine(self.block, inputs, self.first[:-1], self.has_isnan, taken=np.concatenate(taken))
            if not machine.cuts:
                return machine
            for lanes, given in machine.cuts:
                for f in np.unique(owner[lanes]):
                    k = keys(given[:, owner[lanes] == f].ravel())
                    self.ends[f] = np.unique(np.concatenate([self.ends[f], k - 1, k]))
            if sum(map(len, self.ends)) + len(count) == len(owner):
                break
        raise Reject("not decided, however an input is cut")

    def valid(self, machine):
        """bValid is FALSE with any refused input, and TRUE without: then outputs are assigned, and only then."""
        none = np.ones(1, bool)
        anything = [V(np.zeros((2, 1)), none, raw=True)] * self.model.features
        all_taken = Machine(self.block, anything, [0], self.has_isnan, never=machine.never)
        for found, where, truth in ((machine, ~machine.taken, False), (all_taken, none, True)):
            for answer in (found.values["bValid"], *(mask for mask, _ in self.results(found))):
                sure = found.wide(answer).surely(truth)
                need(np.all(sure[where]), "bValid, or where an output is assigned, is not as the model demands")

    def rising(self, machine):
        """Elements of lists that one input decides and that rise with it, with a refused input as with 0.0.

        Their values at both ends of its intervals, with NaN, and the least and the largest of all.
        """
        for key, v in machine.lists.items():
            for f in range(self.model.features):
                lanes, taken = slice(*self.first[f : f + 2]), machine.taken[slice(*self.first[f : f + 2])]
                table, zero = v.a[:, lanes], int(np.searchsorted(self.ends[f], 0))
                if np.any(v.u[lanes]) or np.any(bits(table[:, ~taken]) != bits(table[:, zero : zero + 1])):
                    continue
                low, high = keys(table) if table.dtype == float else table
                if np.all(low <= high) and np.all(low[:-1][taken[:-1]][1:] >= high[:-1][taken[:-1]][:-1]):
                    every = [[table[0, np.argmin(low)]], [table[1, np.argmax(high)]]]
                    yield key, (f, np.append(table, every, axis=1))

    def changes(self, machine):
        """For each input the last keys in front of which a quotient of it changes."""
        for f in range(self.model.features):
            lanes, found = slice(self.first[f], self.first[f + 1] - 1), [np.zeros(0, np.int64)]
            for out in machine.quotients:
                if not np.any(out.u[lanes]):
                    found.append(self.ends[f][:-1][out.a[0, lanes][1:] != out.a[0, lanes][:-1]])
            yield np.unique(np.concatenate(found))

    def parts(self, f, owner, low, high, nan, leaf):
        """Boxes cut where a quotient of one input changes, so that each of its parts has one number of it."""
        model, steps = self.model, self.steps[f]
        free = (low[:, f] > high[:, f]) & ~nan[:, f]
        first, last = (
            np.where(free, end, own[:, f]) for end, own in ((model.first_key[f], low), (model.last_key[f], high))
        )
        begin = np.searchsorted(steps, first)
        pieces = np.where(nan[:, f], 0, np.searchsorted(steps, last) - begin + 1)
        count = pieces + (nan[:, f] | (free & model.nan))
        at = np.repeat(np.arange(len(owner)), count)
        number = np.arange(len(at)) - np.repeat(np.cumsum(count) - count, count)
        missing, here = number == pieces[at], np.append(steps, HIGH)[np.minimum(begin[at] + number, len(steps))]
        before = np.append(LOW - 1, steps)[np.minimum(begin[at] + number, len(steps))]
        low, high, nan = low[at], high[at], nan[at]
        low[:, f] = np.where(missing, HIGH, np.maximum(first[at], before + 1))
        high[:, f] = np.where(missing, LOW, np.minimum(last[at], here))
        nan[:, f] = missing
        return owner[at], low, high, nan, leaf[at]

    def run(self, low, high, nan, covers):
        """The text in boxes: keys of their first and last numbers, or NaN; an input with neither is not limited."""
        ranges = []
        for f, ends in enumerate(self.ends):
            free = (low[:, f] > high[:, f]) & ~nan[:, f]
            places = [np.where(nan[:, f], len(ends), np.searchsorted(ends, side[:, f])) for side in (low, high)]
            ranges.append([np.where(free, -1, place) for place in places])
        known = {key: (table, *ranges[f]) for key, (f, table) in self.known.items()}
        inputs = [V(np.zeros((2, len(low))), np.ones(len(low), bool), raw=True)] * len(ranges)
        machine = Machine(self.block, inputs, covers, self.has_isnan, known=known)
        self.paid |= machine.paid
        return machine

    def cells(self):
        """A table: all combinations of intervals, each evaluated once by text and by model."""
        model, used = self.model, sorted({int(f) for t in self.model.trees for f in t[0]})
        sides = [self.lanes(f) for f in used]
        shape = tuple(int(np.sum(taken)) for _, taken in sides)
        need(np.prod(shape, dtype=float) < 3e6, "too many cells")
        n = int(np.prod(shape))
        low, high, x = (np.full((n, model.features), number) for number in (HIGH, LOW, 0.0))
        for f, (side, taken), at in zip(used, sides, np.indices(shape).reshape(len(shape), n)):
            x[:, f] = side[0, taken][at]
            low[:, f], high[:, f] = (keys(one[taken])[at] for one in side)
        machine = self.run(low, high, np.isnan(x), [0])
        answers = np.array([np.broadcast_to(model.evaluate(x, c), n) for c in range(len(model.base))])
        if model.label:
            answers = [np.argmax(answers, axis=0) if len(answers) > 1 else answers[0] > 0]
        need(not machine.sums, "a sum beside a table")
        for (_, got), want in zip(self.results(machine), answers, strict=True):
            self.same(machine.wide(got), np.asarray(want, float), "a cell is another number")

    @staticmethod
    def same(got, want, reason):
        need(np.all(got.exact), f"{reason}, or not decided")
        need(np.array_equal(bits(got.a[0].astype(float)), bits(want)), reason)

    def sums(self):
        """Sums of trees: in each box of a leaf the term of the text is that leaf; the additions are the library's."""
        model = self.model
        order = [(t, c) for t, (*_, outputs) in enumerate(model.trees) for c in range(len(outputs))]
        boxes = [model.boxes(t) for t in range(len(model.trees))]
        owner = np.repeat(np.arange(len(boxes)), [len(b[3]) for b in boxes])
        low, high, nan, leaf = (np.concatenate([b[i] for b in boxes]) for i in range(4))
        for f, steps in enumerate(self.steps):
            if len(steps):
                owner, low, high, nan, leaf = self.parts(f, owner, low, high, nan, leaf)
        begins = np.searchsorted(owner, np.arange(len(boxes) + 1))
        first, known = 0, None
        while first < len(boxes):
            stop = max(first + 1, int(np.searchsorted(begins, begins[first] + BOXES, "right")) - 1)
            part = slice(begins[first], begins[stop])
            machine = self.run(low[part], high[part], nan[part], begins[first:stop] - begins[first])
            self.reached(machine)
            same, terms = {}, machine.terms[::-1]
            for t, c in order:
                values = model.trees[t][5][:, c]
                # a tree that is the same everywhere may be walked all the same: a term that is this number in all boxes
                if np.all(bits(values) == bits(values[:1])) and not (terms and terms[-1].is_number(values[0])):
                    same[t, c] = float(values[0])
                    continue
                need(terms, "the text has too few terms")
                term = terms.pop()
                if first <= t < stop:
                    mine = slice(*begins[t : t + 2] - begins[first])
                    part_ = V(term.a[:, mine], term.u[mine])
                    self.same(part_, values[leaf[begins[t] : begins[t + 1]]], f"tree {t} differs")
            need(not terms, "the text has more terms than the model has trees")
            need(known in (None, same), "a term is another tree in the boxes of another one")
            first, known = stop, same
        names = {key: ("term", i) for i, key in enumerate(k for k in order if k not in same)}
        wanted = [self.total(output, names, same) for output in range(len(model.base))]
        if model.label:  # the first of the largest, or where the only score is above zero
            zero, one = (("const", number.hex()) for number in (0.0, 1.0))
            largest, best = wanted[0], zero if len(wanted) > 1 else ("if", ("greater", wanted[0], zero), one, zero)
            for number, score in enumerate(wanted[1:], 1):
                larger = "greater", score, largest
                largest, best = ("if", larger, score, largest), ("if", larger, ("const", float(number).hex()), best)
            wanted = [best]
        for (_, got), want in zip(self.results(machine), wanted, strict=True):
            need(isinstance(got, Sum), "an output that is no sum")
            need(self.normal(got.key) == self.normal(want), "other operations than the model's")

    def reached(self, machine):
        """What trees give is added and divided for the outputs only: beside them it could overflow."""
        todo, reached = [got.key for _, got in self.results(machine) if isinstance(got, Sum)], set()
        while todo:
            key = todo.pop()
            if id(key) not in reached:
                reached.add(id(key))
                todo += [part for part in key if isinstance(part, tuple)]
        need(all(id(key) in reached for key in machine.sums), "a sum beside the model's")

    def total(self, output, names, same):
        """The additions of one output in the library's order."""
        model = self.model
        total = ("const", float(0.0 if model.base_last else model.base[output]).hex())
        for t, (*_, outputs) in enumerate(model.trees):
            if output in outputs:
                key = (t, outputs.index(output))
                total = self.rounded(("+", total, names[key] if key in names else ("const", same[key].hex())))
        total = self.rounded(("/", total, ("const", model.divisor.hex()))) if model.divisor != 1.0 else total
        return self.rounded(("+", total, ("const", model.base[output].hex()))) if model.base_last else total

    def rounded(self, key):
        return ("LREAL_TO_REAL", key) if self.model.single_sum else key

    def normal(self, key):
        """The number of the form of an expression, the same for equal forms."""
        if id(key) not in self.made:
            self.made[id(key)] = key, self.forms.setdefault(self.form(key), len(self.forms))
        return self.made[id(key)][1]

    def form(self, key):
        """A flat form of a chain: constants computed, additions of zero dropped where they change nothing."""
        out = []
        while key[0] in NUMERIC:
            out.append((key[0], *key[2:]))
            key = key[1]
        chain, value = [], float.fromhex(key[1]) if key[0] == "const" else None
        start = key if key[0] in ("const", "term") else (key[0], *map(self.normal, key[1:]))
        minus = "-0x0.0p+0"
        for name, *rest in reversed(out):
            const = float.fromhex(rest[0][1]) if rest and rest[0][0] == "const" else None
            if value is not None and (const is not None or not rest):
                with np.errstate(all="ignore"):
                    value = float(NUMERIC[name](np.float64(value), *([np.float64(const)] if rest else [])))
                start = ("const", value.hex())
            elif name == "LREAL_TO_REAL" and chain and chain[-1][0] == name:
                continue
            elif name == "+" and const == 0 and all(step[0] in ("+", "LREAL_TO_REAL") for step in chain):
                if const.hex() != minus and (start[0] != "const" or start[1] == minus):
                    chain = [*chain, (name, *rest)]
            else:
                chain, value = [*chain, (name, *rest)], None
        return start, tuple(chain)


ISNAN = r"""FUNCTION F_IsNan : BOOL VAR_INPUT fValue : LREAL; END_VAR VAR uBits : U_LrealBits; END_VAR VAR CONSTANT
(\w+) : LWORD := 16#7FFFFFFFFFFFFFFF; (\w+) : LWORD := 16#7FF0000000000000; END_VAR
uBits\.fValue := fValue; F_IsNan := \(uBits\.nBits AND \1\) > \2;"""
UNION = "TYPE U_LrealBits : UNION fValue : LREAL; nBits : LWORD; END_UNION END_TYPE"


def tested(e):
    """The place that is tested for NaN by `place < b OR place > a` with b above a, which every number passes."""
    try:
        below, above = e.values
        a, b = (float(ast.literal_eval(c.comparators[0])) for c in (above, below))
        known = isinstance(e.op, ast.Or) and ast.dump(below.left) == ast.dump(above.left) and a < b
        return below.left if known and [type(c.ops[0]) for c in (below, above)] == [ast.Lt, ast.Gt] else None
    except (ValueError, AttributeError):  # not two comparisons with numbers
        return None


def has_isnan(folder, texts):
    """Whether the text tests NaN by the bits, in the one way that is known; else comparisons with it must not stop."""
    # of an attribute in front its first sign is left
    texts = [" ".join(text.replace("{", " ").split()) for text in texts]
    found = all(any(re.fullmatch(form.replace("\n", " "), text) for text in texts) for form in (ISNAN, UNION))
    need(found or not list(folder.rglob("*.[Tt][Cc][Pp][Oo][Uu]")), "no test for NaN by its bits")
    return found


STATEMENT = (
    "For every proved entry and every float64 input (both zeros, denormals, infinities and NaN included) one call of "
    "the block sets bValid to TRUE exactly where the model has an answer, and then the outputs have the bits that the "
    "model file demands for the inputs, after these are limited to the ranges in which bundle.toml or st-codegen.toml "
    "limits them; where bValid is FALSE the outputs keep their last values. Where the method is the model's "
    "expression, the outputs are the operations that the model demands, in their order, none of them fails for any "
    "input, and they lie within the bound, where there is one, of the library's answer on the declared ranges."
)
ASSUMPTIONS = [
    "LREAL and REAL are IEEE 754 binary64 and binary32, rounded to nearest, ties to even, with denormals",
    "the compiler keeps the order and the roundings of the text: no extended precision, no fused multiply-add",
    "integers, comparisons, arrays and conversions are those of IEC 61131-3",
    "variables start with the initial values of the text, and nothing but the block writes to its instance",
    "the rules of the library are those that docs/proof.md lists",
]
PARTS = {"format", "statement", "assumptions", "models", "texts", "proofs", "blocks"}
ENTRY = {"model", "file", "target", "block", "outputs", "inputs", "verdict", "method", "trees"}
UNPROVED = ENTRY - {"method", "trees"} | {"reason"}
BY_CLASS = "the model's expression of its trees"
EXPRESSIONS = {"the model's expression", BY_CLASS}
BLOCK = {"block", "target", "verdict"}
#: Files of Structured Text, and those of them that are read here.
READ = {".st", ".tcpou", ".tcdut", ".tcgvl"}
TEXTS = READ | {".scl", ".xml"}


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def names_class(entry):
    """Whether the only output is the number of a class: names of whole numbers begin with n, all others with f."""
    return [name[:1] for name in entry["outputs"]] == ["n"]


def read_certificate(path):
    """A certificate in which nothing stands twice, since readers differ in which one counts, and all is a number."""

    def named(pairs):
        need(len(dict(pairs)) == len(pairs), "a name twice in the certificate")
        return dict(pairs)

    def refused(word):
        raise Reject(f"{word} in the certificate")

    return json.loads(Path(path).read_text("utf-8"), object_pairs_hook=named, parse_constant=refused)


def inside(folder, name):
    """What a name of the certificate leads to in a folder: no way up, no root, no drive, no link that leaves it."""
    need(not re.search(r"[\\:]", name) and not {"", ".", ".."} & set(name.split("/")), f"{name!r} is no plain path")
    path = folder / name
    need(path.resolve().is_relative_to(folder.resolve()), f"{name!r} leads out of the folder")
    return path


def texts_in(folder):
    """The files with Structured Text below a folder, of which none may be hidden behind a link."""
    every = list(folder.rglob("*"))
    need(not any(path.is_symlink() for path in every), f"a link in {folder.name}")
    return [path for path in every if path.suffix.lower() in TEXTS]


def unread(folder):
    """Why nothing is said of the texts of a folder: a file of them is not read here, and may be what is imported."""
    names = sorted(path.name for path in texts_in(folder) if path.suffix.lower() not in READ)
    return f"not checked: {names[0]} is not read by this checker" if names else None


#: Function blocks in files that need not be as they are generated.
BETWEEN = r"(?:\s|//[^\n]*|(?>\(\*.*?\*\))|(?>/\*.*?\*/)|(?>\{.*?\}))++"
BLOCK_NAME = re.compile(
    rf"(?is)\bFUNCTION_BLOCK{BETWEEN}(?:(?:PUBLIC|INTERNAL|PRIVATE|PROTECTED|ABSTRACT|FINAL|OVERRIDE){BETWEEN})*"
    r"\"?(\w+)"
)


def blocks_in(path):
    """The names of the function blocks of a file, in small letters."""
    text = PIECE.sub(" ", path.read_bytes().decode("utf-8", "replace"))
    return {name.lower() for name in BLOCK_NAME.findall(text)}


def unchecked(entry):
    """Why an entry is not checked here; None for one that is."""
    if entry["verdict"] in ("not proved", "refuted") and entry.keys() == UNPROVED:
        return f"{entry['verdict']}, by its own words"
    method = entry.get("method")
    expression = entry["verdict"] == "proved" and method in EXPRESSIONS and entry.keys() - {"bound"} == ENTRY
    need(expression or (entry["verdict"] == "proved" and entry.keys() == ENTRY), "another form of entry")
    if expression and (method != BY_CLASS or not names_class(entry)):
        return "not checked: expressions are outside of this checker"
    need(entry.get("bound", [0.0]) == [0.0], "a bound of a class")
    if entry["outputs"][0].startswith("n") and len(entry["outputs"]) > 1:
        return "not checked: chances and scores of classes are outside of this checker"
    return None


def usual(features):
    """The names of inputs that are made of those of features."""
    return ["f" + re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") for name in features]


def limit(model, entry, ranges, given):
    """Number the inputs as the block's are, and take the limits that bundle.toml or st-codegen.toml give them.

    Returns the names that the block's inputs have, as st-codegen.toml or the features' own names say.
    """
    names = model.names or [f"f{number}" for number in range(model.features)]
    called = usual(entry["inputs"])
    if ranges is not None:
        need([r["name"] for r in ranges] == entry["inputs"], "other inputs than those of the bundle")
        if model.names and sorted(model.names) == sorted(entry["inputs"]):
            model.order(model.names, entry["inputs"])
    else:
        need(entry["inputs"] == names, "other inputs than those of the model")
        said = [r for r in given if r.get("file", "") in ("", entry["file"])]
        ranges = [next((r for r in said[::-1] if r["feature"] == name), {}) for name in names]
        called = [r.get("name", own) for r, own in zip(ranges, called)]
        ranges = [r if r.get("outside", "clamp") == "clamp" else {} for r in ranges]
    for side, far, bound in (("min", -np.inf, model.lower), ("max", np.inf, model.upper)):
        bound[:] = [float(r.get(side, far)) for r in ranges]
    return called


def named(entry, together):
    """The file of an entry where it is called otherwise, and the outputs in a bundle, whose blocks hold several models.

    Elsewhere the block has the name of its model.
    """
    model, file, block = entry["model"], entry["file"], entry["block"].lower()
    need(re.fullmatch(r"[a-z_]\w*", block, re.A), f"the name of the block {block}")
    stem = Path(file).stem
    own = re.sub("_+", "_", re.sub(r"\W", "_", model, flags=re.A)).strip("_").lower()
    need(model == stem or block == f"fb_{own}", "another file")  # a name that the settings or the user gave
    need(together or (block.startswith("fb_") and block.endswith(own)), "another model's block")  # behind a prefix
    said = [file] * (model != stem) + [f"{entry['block']}.{name}" for name in entry["outputs"]] * together
    return f" ({', '.join(said)})" if said else ""


def folder_of(target, out):
    """The folder of a target: in the given one, or that one itself, which may also be called as its target is."""
    return out if out.name == target and not (out / target).is_dir() else inside(out, target)


def unsaid(out, said):
    """Print the blocks of the texts below a folder that are not among those (folder, block) of which entries speak."""
    for path in sorted(texts_in(out)):
        for name in sorted(blocks_in(path)):
            if not any(name == block and path.is_relative_to(folder) for folder, block in said):
                print(f"{path.relative_to(out).as_posix()}: nothing is said of {name}")


def main(certificate, models, out):
    """Say of each entry if it is confirmed; how many are, of how many. Raises Reject for one that does not hold."""
    content = read_certificate(certificate)
    models, out = Path(models), Path(out).resolve()
    folder = models if models.is_dir() else models.parent
    need(content.keys() == PARTS and content["format"] == "st-codegen certificate 1", "another format")
    need(content["statement"] == STATEMENT and content["assumptions"] == ASSUMPTIONS, "another statement")
    proofs, bundle, settings = content["proofs"], folder / "bundle.toml", folder / "st-codegen.toml"
    need(models.is_dir() or {e["file"] for e in proofs} == {models.name}, "entries of another file than the given one")
    files = {e["file"] for e in proofs} | {path.name for path in (bundle, settings) if path.is_file()}
    # beside them the files in which the numbers of a model stand
    need(content["models"].keys() >= files, "other model files")
    held = {name: inside(folder, name) for name in content["models"]}
    need(all(path.is_file() and content["models"][n] == sha256(path) for n, path in held.items()), "other model files")
    targets = {name: folder_of(name, out) for name in content["texts"]}
    for target, path in targets.items():
        need("/" not in target and path.is_dir(), f"{target}: no such folder")
        texts = {p.relative_to(path).as_posix(): sha256(p) for p in texts_in(path)}
        need(content["texts"][target] == texts, f"{target}: other texts")
    every = {(name, target) for name in {e["model"] for e in proofs} for target in targets}
    need(proofs and {(e["model"], e["target"]) for e in proofs} == every and len(proofs) == len(every), "entries")
    form = {True: BLOCK | {"claims"}, False: BLOCK | {"reason"}}
    need(all(e.keys() == form[e["verdict"] == "proved"] for e in content["blocks"]), "another form of block")
    need(bundle.is_file() or not content["blocks"], "blocks around models that stand alone")
    confirmed, ranges = 0, tomllib.loads(bundle.read_text("utf-8"))["feature"] if bundle.is_file() else None
    given = tomllib.loads(settings.read_text("utf-8")).get("input", []) if settings.is_file() else []
    for entry in proofs:
        where = f"{entry['model']}, {entry['target']}"
        try:
            where += named(entry, bundle.is_file())
            block = entry["block"].lower()
            shared = [e for e in proofs if e is not entry and e["target"] == entry["target"]]
            others = [name for e in shared if e["block"].lower() == block for name in e["outputs"]]
            other = unchecked(entry) or unread(targets[entry["target"]])
            try:
                model = other or read_model(folder / entry["file"])
                need(other or model.label == names_class(entry), "a decision of another kind")
            except Reject as outside:
                other = f"not checked: {outside}"
            if other:
                print(f"{where}: {other}")
                continue
            called = limit(model, entry, ranges, given)
            found = Check(model, targets[entry["target"]], entry, others, called)
            need((found.method, found.trees) == (entry["method"], entry["trees"]), "proved in another way")
        except Reject as reason:
            raise Reject(f"{where}: {reason}") from None
        confirmed += 1
        print(f"{where}: confirmed")
    for path in sorted(folder.iterdir()) if models.is_dir() else ():
        if path.suffix in KINDS and path.name not in content["models"]:
            print(f"{path.name}: nothing is said of this file")
    unsaid(out, {(targets[e["target"]], e["block"].lower()) for e in proofs + content["blocks"]})
    for entry in content["blocks"]:
        claim = "not proved, by its own words" if "reason" in entry else "not checked: invariants of calls"
        print(f"{entry['block']}, {entry['target']}: {claim}")
    return confirmed, len(proofs) + len(content["blocks"])


if __name__ == "__main__":
    if len(sys.argv) != 4:
        print("usage: check_certificate.py CERTIFICATE MODELS OUT")
        sys.exit(2)
    try:
        done, every = main(*sys.argv[1:])
    except REJECTIONS as error:
        print(f"rejected: {type(error).__name__}: {error}")
        sys.exit(1)
    if done == every:
        print("accepted: the only entry is confirmed" if every == 1 else f"accepted: all {every} entries are confirmed")
        sys.exit(0)
    print(f"accepted in part only; entries confirmed: {done} of {every}")
    sys.exit(3)
