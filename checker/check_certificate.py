"""Checks a certificate of `st-codegen prove` against the model files and the generated text, sharing no code with it.

    python checker/check_certificate.py CERTIFICATE MODELS OUT
        exit 0: every entry is confirmed; 1: rejected; 2: wrong use; 3: some entries are not checked here

Needs NumPy and the standard library. docs/proof.md explains why what is done here is a proof, and what is outside.
"""

import ast
import hashlib
import json
import keyword
import re
import sys
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from model_files import HIGH, LOW, Reject, bits, keys, need, numbers, read_model, single

#: What a file that is not as it should be may raise.
REJECTIONS = (Reject, OSError, ValueError, LookupError, TypeError, AttributeError, OverflowError, SyntaxError)

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
            depth, words = depth - 1, [token]
        elif token in ("IF", "ELSIF"):
            words.append({"IF": "if", "ELSIF": "elif"}[token])
        elif token == "FOR":
            loop = True
        else:
            plain = token[0].isalnum() and not keyword.iskeyword(token)
            need(plain or token in WORDS or token in KNOWN, f"'{token}', which is a word of Python or not known")
            words.append(
                str(int(token.split("16#")[1].replace("_", ""), 16)) if "16#" in token else WORDS.get(token, token)
            )
    need(not words, "the text ends in a statement")
    return ast.parse("\n".join(lines)).body


def codes(folder):
    """The Structured Text of all files of a target, without comments. Their names mean what the standard says."""
    found = []
    for path in sorted(path for path in folder.rglob("*") if path.suffix.lower() in (".st", ".tcpou", ".tcdut")):
        text = path.read_text("utf-8-sig")
        if path.suffix.lower() != ".st":
            parts = [e for e in ElementTree.fromstring(text.encode()).iter() if e.tag in ("Declaration", "ST")]
            need(len(parts) < 3, f"{path.name}: methods, or several units")
            text = "\n".join(e.text for e in parts)
        found.append(re.sub(r"\(\*.*?\*\)", " ", text, flags=re.S))
    every = "\n".join(found)
    names = [name.upper() for name in re.findall(r"\b(?:FUNCTION|FUNCTION_BLOCK)\s+(\w+)", every, re.I)]
    names += [name.upper() for name in re.findall(r"\b(\w+)\s*:\s*(?:STRUCT|UNION)\b", every, re.I)]
    other = rf"(?i)\b(?:{'|'.join(STANDARD)})\s*:(?!=)|\bFUNCTION\s+(?:{'|'.join(STANDARD)})\b"
    need(len(set(names)) == len(names) and not re.search(other, every), "a name of two meanings")
    return found


def read_block(folder, name):
    """Inputs, outputs, constants, initial values and statements of a function block."""
    form = rf"^FUNCTION_BLOCK {name}$(.*?)(?:^END_FUNCTION_BLOCK|\Z)"
    parts = [(text, part) for text in codes(folder) for part in re.findall(form, text, re.S | re.M | re.I)]
    need(len(parts) == 1, f"{len(parts)} blocks {name} in {folder}")
    known = parts[0][0].isascii() and not re.search(r"[{'\"$^]|//|\*\)", parts[0][0])
    need(known, "attributes, strings, pointers, or a comment in a comment")
    text = parts[0][1]
    ports, constants, values, end = {"VAR_INPUT": [], "VAR_OUTPUT": []}, set(), {}, 0
    for section in re.finditer(r"\s*(VAR\w*)( CONSTANT)?\s(.*?)END_VAR", text, re.S):
        need(section.start() == end and section[1] in ("VAR", *ports), "text between declarations, or another section")
        end = section.end()
        for line in filter(None, map(str.strip, section[3].split(";"))):
            form = re.fullmatch(
                r"(\w+) : (?:ARRAY\[0\.\.(\d+)\] OF )?(LREAL|[SD]?INT|BOOL|DWORD)(?:\s*:=\s*(.*))?", line, re.S
            )
            known = {name.lower() for name in values}
            narrow = form and not section[2] and form[3] in ("SINT", "INT")
            need(form and form[1].lower() not in known and not narrow, f"the declaration {line[:60]}")
            kind = {"LREAL": float, "BOOL": bool}.get(form[3], int)
            size, given = int(form[2] or 0) + 1, re.sub(r"\w*#?16#(\w+)", lambda m: str(int(m[1], 16)), form[4] or "")
            need(not (given and kind is bool), "an initial truth value")
            items = [kind(n) for n in given.strip("[] \n").split(",")] if given else [kind(0)] * size
            need(len(items) == size, f"{form[1]}: another number of elements")
            values[form[1]] = (np.array(items) if section[2] else items) if form[2] else items[0]
            constants |= {form[1]} if section[2] else set()
            ports.get(section[1], []).append(form[1])
    need("VAR" not in text[end:].split(), "declarations behind statements")
    return *ports.values(), constants, values, translated(text[end:])


# --- executing the text on many inputs at once ------------------------------------------------------------------------
class V:
    """A value in three corners of each box, `a` of shape (3, boxes): all inputs low, all high, all open ones NaN.

    `d`: the inputs it depends on, as bits; bit 62: nothing is known of it, for a comparison was not the same in the
    whole box. `src`: the input that it varies with inside of the box, between its values in the corners.
    """

    def __init__(self, a, d, src=None, plain=False, conj=False):
        self.a, self.d, self.src, self.plain, self.conj = a, d, src, plain, conj


class Sum:
    """An expression of what trees give: `key` is its shape, with the numbers of the terms in `Machine.terms`."""

    def __init__(self, key):
        self.key = key


UNDECIDED = np.int64(1 << 62)
COMPARE = {
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
    ast.Eq: np.equal,
    ast.NotEq: np.not_equal,
}
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


CONVERSIONS = {"DINT_TO_LREAL": np.float64, "REAL_TO_LREAL": np.float64, "BOOL_TO_DINT": np.int64, "TRUNC": np.int64}
CONVERSIONS |= {"SINT_TO_DINT": np.int64, "INT_TO_DINT": np.int64}
#: Types and functions that no text may define anew.
STANDARD = {"LREAL", "REAL", "DINT", "INT", "SINT", "BOOL", "DWORD", "LWORD", "DINT_TO_DWORD", "DWORD_TO_DINT"}
STANDARD |= NUMERIC.keys() - set("+-*/") | CONVERSIONS.keys()


class Machine:
    """One call of a block in the corners `x` (2, boxes, inputs) of boxes."""

    def __init__(self, block, x, has_isnan, profiles=None):
        self.inputs, self.outputs, self.constants, values, self.statements = block
        x = x if len(x) == 3 else np.concatenate([x, x[:1]])
        self.x, self.n, self.has_isnan, self.terms, self.cuts = x, x.shape[1], has_isnan, [], []
        self.profiles, self.seen, self.changed, self.quotients = profiles or {}, set(), set(), []
        self.values = {k: list(v) if isinstance(v, list) else v for k, v in values.items()}
        self.assigned, self.early, self.none = {(i, 0) for i in self.inputs}, set(), np.zeros(self.n, np.int64)
        need(len(self.inputs) == x.shape[2] < 62, "another number of inputs")
        for f, name in enumerate(self.inputs):
            self.values[name] = V(x[:, :, f], self.none | (1 << f), f, plain=True)
        self.block(self.statements, True)
        need(not self.early & self.assigned, "a variable is read before it is assigned")

    def wide(self, v):
        need(isinstance(v, V | bool | int | float), "a sum of trees where a number is needed")
        return v if isinstance(v, V) else V(np.full((3, self.n), v), self.none)

    @staticmethod
    def made(out, d, operands, **facts):
        """A result. Of several inputs it must not tell NaN from numbers, nor may two operands: then what holds for all
        open inputs NaN and for none holds for some of them, too."""
        several = d & ~UNDECIDED & ((d & ~UNDECIDED) - 1) > 0
        vary = sum((bits(o.a[0]) != bits(o.a[2])).astype(int) for o in operands)
        wrong = several & ((bits(out[0]) != bits(out[2])) | (vary > 1))
        return V(out, d | np.where(wrong, UNDECIDED, 0), **facts)

    def holds(self, mask):
        return np.ones((3, self.n), bool) if mask is True else mask.a

    def block(self, statements, mask):
        left = False  # where a loop was left
        for s in statements:
            gone = False
            if isinstance(s, ast.Assign):
                self.assign(s.targets[0], self.value(s.value, mask), mask)
            elif isinstance(s, ast.Break):
                gone = mask
            elif isinstance(s, ast.If):
                test = self.value(s.test, mask)
                if isinstance(test, Sum):
                    self.choose(s, test, mask)
                    continue
                yes, no = self.logic(np.logical_and, mask, test), self.logic(np.logical_and, mask, self.opposite(test))
                for body, where in ((s.body, yes), (s.orelse, no)):
                    if body and where is not False and np.any(self.holds(where)):
                        gone = self.logic(np.logical_or, gone, self.block(body, where))
            else:
                need(isinstance(s, ast.For), "a statement of another kind")
                bounds = [self.value(a, mask) for a in s.iter.args]
                need(all(type(b) is int for b in bounds) and bounds[2] > 0, "a loop whose bounds depend on the inputs")
                need(bounds[1] + bounds[2] < 2**31, "a loop that never ends")
                names = [n for part in s.body for n in ast.walk(part) if isinstance(n, ast.Name)]
                stores = {n.id for n in names if isinstance(n.ctx, ast.Store)}
                need(s.target.id not in stores, "a counter that its loop assigns")
                read = {n.id for part in s.iter.args for n in ast.walk(part) if isinstance(n, ast.Name)}
                need(not read & {s.target.id, *stores}, "a loop whose bounds change in it")
                inside = mask
                for counter in range(bounds[0], bounds[1] + 1, bounds[2]):
                    self.assign(s.target, counter, True)
                    inside = self.logic(np.logical_and, inside, self.opposite(self.block(s.body, inside)))
                    if inside is False or not np.any(self.holds(inside)):
                        break
                self.values[s.target.id] = None
            left = self.logic(np.logical_or, left, gone)
            mask = self.logic(np.logical_and, mask, self.opposite(gone))
        return left

    def choose(self, s, test, mask):
        """Assignments under a condition on sums: both values are kept."""
        need(mask is True and not s.orelse and all(isinstance(part, ast.Assign) for part in s.body), "a condition")
        for part in s.body:
            new, old = (self.term(self.value(e, True)) for e in (part.value, part.targets[0]))
            self.assign(part.targets[0], Sum(("if", test.key, new, old)), True)

    def assign(self, target, new, mask):
        name = target.id if isinstance(target, ast.Name) else target.value.id
        place = 0 if isinstance(target, ast.Name) else self.value(target.slice, mask)
        need(name in self.values and name not in self.constants and name not in self.inputs, f"{name} is assigned")
        need(name not in self.outputs or (name, place) not in self.assigned, f"{name} is assigned twice")
        array = isinstance(target, ast.Subscript)
        need(type(place) is int and (not array or 0 <= place < len(self.values[name])), f"{name}: an index")
        old = self.values[name][place] if array else self.values[name]
        if mask is not True and name in self.outputs:
            new = ("if", mask, new)
        elif mask is not True:
            conj = new is False and (old is True or (isinstance(old, V) and old.conj))
            new = self.wide(new)
            old = (
                self.wide(old)
                if (name, place) in self.assigned and not isinstance(old, Sum)
                else V(new.a, new.d | UNDECIDED)
            )
            src = new.src if old.src is None else old.src
            need(new.src in (None, src), "a value of two inputs")
            same = np.all(mask.a[0] == mask.a[1]) or not (conj and src is None)
            single_input = conj and same and not np.any(mask.d & (mask.d - 1))
            d = mask.d | np.where(np.any(mask.a, axis=0), new.d, 0) | np.where(np.all(mask.a, axis=0), 0, old.d)
            facts = {"src": src, "plain": new.plain or old.plain, "conj": single_input}
            new = self.made(np.where(mask.a, new.a, old.a), d, () if conj else (new, old, mask), **facts)
        if array:
            self.values[name][place] = new
        else:
            self.values[name] = new
        self.assigned.add((name, place))
        self.changed |= {(name, place)} & self.seen

    def logic(self, how, a, b):
        for one, other in ((a, b), (b, a)):
            if isinstance(one, bool):
                return other if one is (how is np.logical_and) else one
        open_ = np.any(a.a if how is np.logical_and else ~a.a, axis=0)  # elsewhere `a` alone decides
        return self.made(how(a.a, b.a), a.d | np.where(open_, b.d, 0), (a, b))

    def opposite(self, v):
        return not v if isinstance(v, bool) else V(~v.a.astype(bool), v.d)

    def value(self, e, mask):
        if isinstance(e, ast.Constant):
            return e.value
        if isinstance(e, ast.Name):
            return self.read(e.id, 0, self.values.get(e.id))
        if isinstance(e, ast.Subscript):
            return self.element(e.value.id, self.value(e.slice, mask), mask)
        if isinstance(e, ast.BoolOp):
            if (place := tested(e)) is not None:
                return self.opposite(self.is_nan(self.value(place, mask)))
            parts = [self.value(v, mask) for v in e.values]
            for part in parts[1:]:
                parts[0] = self.logic(np.logical_and if isinstance(e.op, ast.And) else np.logical_or, parts[0], part)
            return parts[0]
        if isinstance(e, ast.UnaryOp):
            inner = self.value(e.operand, mask)
            return self.opposite(inner) if isinstance(e.op, ast.Invert) else self.number("NEG", [inner], mask)
        if isinstance(e, ast.BinOp):
            name = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}[type(e.op)]
            return self.number(name, [self.value(e.left, mask), self.value(e.right, mask)], mask)
        if isinstance(e, ast.Compare):
            need(len(e.ops) == 1, "comparisons in a row")
            a, b = self.value(e.left, mask), self.value(e.comparators[0], mask)
            return self.compare(COMPARE[type(e.ops[0])], a, b, mask)
        name = e.func.id
        if name == "DWORD_TO_DINT":
            need(isinstance(e.args[0], ast.BoolOp) and isinstance(e.args[0].op, ast.And), "bits")
            number, bits_ = e.args[0].values
            a, b = self.wide(self.value(number.args[0], mask)), self.value(bits_, mask)
            need(number.func.id == "DINT_TO_DWORD" and type(b) is int and 0 <= b < 2**31, "bits")
            return V(a.a & b, a.d)
        values = [self.value(a, mask) for a in e.args]
        if name == "F_IsNan":
            need(self.has_isnan, "F_IsNan is another function")
            return self.is_nan(values[0])
        if name in CONVERSIONS:
            return self.converted(name, values[0], mask)
        need(name in NUMERIC, f"the function {name}")
        return self.number(name, values, mask)

    def converted(self, name, v, mask):
        """A number in another type. Of expressions only labels are cut to integers: a choice of whole numbers."""
        if isinstance(v, Sum):
            need(name != "TRUNC" or is_label(v.key), "TRUNC of a sum")
            return v
        v = self.wide(v)
        fits = np.abs(v.a) < 2.0**31 if name == "TRUNC" else np.full(v.a.shape, True)
        need(np.all(fits | ~self.holds(mask) | (v.d & UNDECIDED > 0)), "TRUNC of what is too large")
        return V(np.where(fits, v.a, 0).astype(CONVERSIONS[name]), v.d, v.src)

    def read(self, name, place, value):
        need(value is not None and name not in self.outputs, f"{name} is read")
        if name not in self.constants and (name, place) not in self.assigned:
            self.early.add((name, place))  # its initial value, which nothing may change
        self.seen.add((name, place))
        if (name, place) in self.profiles and isinstance(value, V) and np.any(value.d & UNDECIDED):
            f, ends, sides = self.profiles[name, place]  # what it is in each interval of its one input
            lane = np.where(np.isnan(self.x[:, :, f]), len(ends), np.searchsorted(ends, keys(self.x[:, :, f])))
            return V(np.array([sides[i][lane[i]] for i in (0, 1, 0)]), self.none | (1 << f), f)
        return value

    def element(self, name, index, mask):
        table = self.values[name]
        if type(index) is int:
            need(0 <= index < len(table), "an index out of range")
            return self.read(name, index, table[index] if isinstance(table, list) else table[index].item())
        ok = (index.a >= 0) & (index.a < len(table))
        need(index.src is None and np.all(ok | ~self.holds(mask) | (index.d & UNDECIDED > 0)), "an index out of range")
        at = np.where(ok, index.a, 0)
        if isinstance(table, np.ndarray):
            return self.made(table[at], index.d, ())
        used = np.unique(at[ok & self.holds(mask)]).tolist()
        if not used:
            return V(np.zeros((3, self.n), bool), index.d | UNDECIDED)
        items = {p: self.wide(self.read(name, p, table[p])) for p in used}
        out = V(np.zeros((3, self.n), items[used[0]].a.dtype), index.d.copy(), "several")
        for p, item in items.items():
            out.a = np.where(at == p, item.a, out.a)
            out.d = out.d | np.where(np.any(at == p, axis=0), item.d, 0)
        src = None if all(item.src is None for item in items.values()) else "several"
        return V(out.a, out.d | np.where((bits(at[0]) != bits(at[2])), UNDECIDED, 0), src)

    def number(self, name, values, mask):
        floats = any(isinstance(v, Sum | float) or (isinstance(v, V) and v.a.dtype == float) for v in values)
        fixed = [v for v in values if isinstance(v, V) and v.src is None]
        if name == "/" and not floats:
            return self.quotient(*values)
        if any(isinstance(v, Sum) for v in values) or (floats and name in ("+", "MIN", "MAX") and fixed):
            return Sum((name, *(self.term(v) for v in values)))
        with np.errstate(all="ignore"):
            if all(not isinstance(v, V) for v in values):
                out = NUMERIC[name](*(np.float64(v) if floats else v for v in values))
                need(np.isfinite(out) if floats else abs(out) < 2**31, "a constant that overflows")
                return float(out) if floats else int(out)
            wide = [self.wide(v) for v in values]
            moving = [v.src for v in wide if v.src is not None]
            need(len(moving) < 2 and (name != "/" or wide[1].src is None), "arithmetic on two inputs")
            out = NUMERIC[name](*(v.a for v in wide))
        d = np.bitwise_or.reduce([v.d for v in wide])
        active = self.holds(mask) & (d & UNDECIDED == 0)
        if floats:
            fine = ~np.all([np.isfinite(v.a) for v in wide], axis=0) & ~np.any([np.isnan(v.a) for v in wide], axis=0)
            need(np.all(np.isfinite(out) | fine | ~active), f"{name} can overflow or meet NaN")
            if name == "ABS":  # on both sides of zero the values lie between 0 and the larger corner
                across = (wide[0].a[0] < 0) != (wide[0].a[1] < 0)
                out = np.where(across, np.array([np.zeros(self.n), np.max(out[:2], axis=0), out[2]]), out)
        else:
            need(np.all((np.abs(out) < 2**31) | ~active), "an integer overflows")
        return self.made(out, d, wide, src=moving[0] if moving else None)

    def quotient(self, a, b):
        """A whole number from 0 on by a constant, which rises with it: constant in a box where its corners agree."""
        need(type(b) is int and b > 0, "a division by a number that is no constant above 0")
        a = self.wide(a)
        need(np.all((a.a >= 0) | (a.d & UNDECIDED > 0)), "a division of a number below 0")
        out = a.a.astype(np.int64) // b
        self.quotients.append(out)
        return self.made(out, a.d | np.where(out[0] != out[1], UNDECIDED, 0), (a,))

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
        return V(nan, v.d | np.where(nan[0] != nan[1], UNDECIDED, 0))

    def compare(self, how, a, b, mask):
        if isinstance(a, Sum) or isinstance(b, Sum):
            return Sum((how.__name__, self.term(a), self.term(b)))
        if not isinstance(a, V) and not isinstance(b, V):
            return bool(how(a, b))
        a, b = self.wide(a), self.wide(b)
        need(a.src is None or b.src is None, "a comparison of two inputs")
        d = a.d | b.d
        nan = (np.isnan(a.a) | np.isnan(b.a)) & self.holds(mask)
        need(not np.any(nan & (d & UNDECIDED == 0)), "a comparison with NaN")
        out = how(a.a, b.a)
        differ = out[0] != out[1]
        moving, other = (a, b) if a.src is not None else (b, a)
        if moving.plain and np.any(differ):
            self.cuts.append((moving.src, np.unique(other.a[:, differ])))
        return self.made(out, d | np.where(differ, UNDECIDED, 0), (a, b))


def is_label(key):
    """Whether an expression chooses between small whole numbers."""
    if key[0] == "if":
        return is_label(key[2]) and is_label(key[3])
    return key[0] == "const" and float.fromhex(key[1]) in range(1 << 15)


# --- the check --------------------------------------------------------------------------------------------------------
class Check:
    """One model against the outputs of a block that the certificate names."""

    def __init__(self, model, folder, entry):
        model.prepare()
        self.made, self.forms = {}, {}
        self.model, self.block, self.has_isnan = model, read_block(folder, entry["block"]), has_isnan(folder)
        self.ends, ports = [], [name.lower() for name in self.block[0]]
        for f, name in enumerate(entry["inputs"]):
            port = f"f{name}".lower()
            need(port not in ports or ports.index(port) == f, "inputs in another order")
            inner = [last[t[0] == f] for t, last in zip(model.trees, model.last)]
            edges = keys([model.lower[f], model.upper[f]])
            ends = [model.first_key[f] - 1, model.last_key[f], LOW, HIGH - 1, -2, -1, 0, HIGH]
            self.ends.append(np.unique(np.concatenate([*inner, edges - 1, edges, ends])))
        machine, boxes = self.alone()
        self.profiles = dict(self.rising(machine))
        self.steps = list(self.changes(machine))
        valid = machine.values["bValid"]
        parts = [machine.values[name] for name in entry["outputs"]]
        self.valid(valid, boxes, machine)
        results = [o[2] if isinstance(o, tuple) else o for o in parts]
        for o in parts:
            same = isinstance(o, tuple) and isinstance(valid, V) and np.array_equal(o[1].a, valid.a)
            need(same or (valid is True and not isinstance(o, tuple)), "an output that does not keep to bValid")
        need(len(results) == (1 if model.label else len(model.base)), "another number of outputs")
        terms = [(t[5][:, c]) for t in model.trees for c in range(len(t[6]))]
        self.trees = sum(bool(np.any(bits(v) != bits(v[:1]))) for v in terms)
        sums = any(isinstance(r, Sum) for r in results)
        self.method = (BY_CLASS if model.label else "sums of trees, tree by tree") if sums else "all cells"
        if sums:
            self.sums(entry)
        else:
            used = np.bitwise_or.reduce([np.bitwise_or.reduce(machine.wide(r).d) for r in results])
            self.cells(
                entry, [f for f in range(model.features) if used >> f & 1 or any(f in t[0] for t in model.trees)]
            )

    def lanes(self, f):
        """Keys of the first and last number of each interval of an input, NaN behind them; which the model takes."""
        ends = self.ends[f] = self.ends[f][(self.ends[f] >= LOW) & (self.ends[f] <= HIGH)]
        starts = np.append(LOW, ends[:-1] + 1)
        taken = np.append((starts >= self.model.first_key[f]) & (ends <= self.model.last_key[f]), self.model.nan)
        return np.array([np.append(numbers(k), np.nan) for k in (starts, ends)]), taken

    def alone(self):
        """Each input varies while the others are 0.0; intervals are cut until every comparison is decided."""
        while True:
            sides = [self.lanes(f)[0] for f in range(self.model.features)]
            x = np.zeros((2, sum(s.shape[1] for s in sides), len(sides)))
            at = 0
            for f, side in enumerate(sides):
                x[:, at : at + side.shape[1], f] = side
                at += side.shape[1]
            machine = Machine(self.block, x, self.has_isnan)
            if not machine.cuts:
                return machine, x
            before = sum(map(len, self.ends))
            for f, given in machine.cuts:
                k = keys(given)
                self.ends[f] = np.unique(np.concatenate([self.ends[f], k - 1, k]))
            need(sum(map(len, self.ends)) > before, "a comparison that is not decided, however an input is cut")

    def rising(self, machine):
        """Elements of lists that rise with one input: the values at both ends of its intervals."""
        first = np.cumsum([0] + [len(self.lanes(f)[1]) for f in range(self.model.features)])
        for name, items in machine.values.items():
            for place, v in enumerate(items) if isinstance(items, list) else ():
                inputs = int(np.bitwise_or.reduce(v.d)) if isinstance(v, V) else 0
                if inputs and not inputs & (inputs - 1) and (name, place) not in machine.changed:
                    f = inputs.bit_length() - 1
                    low, high = v.a[:2, first[f] : first[f + 1]]
                    taken = self.lanes(f)[1][:-1]
                    if np.all(low[:-1] <= high[:-1]) and np.all(low[:-1][taken][1:] >= high[:-1][taken][:-1]):
                        yield (name, place), (f, self.ends[f], (low, high))

    def changes(self, machine):
        """For each input the last key in front of which any quotient changes, where the others are 0.0."""
        at = 0
        for f in range(self.model.features):
            stop = at + len(self.ends[f])
            found = [self.ends[f][:-1][out[0, at : stop - 1] != out[0, at + 1 : stop]] for out in machine.quotients]
            yield np.unique(np.concatenate([*found, np.zeros(0, np.int64)]))
            at = stop + 1  # behind NaN

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

    def valid(self, valid, x, machine):
        """bValid is the conjunction of what each input alone demands; refused inputs count as 0.0 from there on."""
        taken = np.concatenate([self.lanes(f)[1] for f in range(self.model.features)])
        got = np.full((3, x.shape[1]), True) if valid is True else valid.a
        need(valid is True or valid.conj, "bValid is no conjunction")
        need(np.array_equal(got, np.array([taken] * 3)), "bValid is not what the model demands")
        base = int(np.flatnonzero(np.all(bits(x) == 0, axis=(0, 2)))[0])
        for name, value in machine.values.items():
            for item in value if isinstance(value, list) else [value]:
                if (
                    isinstance(item, V)
                    and name not in machine.inputs
                    and not item.conj
                    and not np.any(item.d & UNDECIDED)
                ):
                    alike = bits(item.a) == bits(np.repeat(item.a[:, base : base + 1], len(taken), axis=1))
                    need(np.all(alike[:, ~taken]), f"{name}: a refused input counts")

    def cells(self, entry, used):
        """A table: all combinations of intervals, each evaluated once by text and by model."""
        sides = [self.lanes(f) for f in used]
        shape = tuple(int(np.sum(taken)) for _, taken in sides)
        need(np.prod(shape, dtype=float) < 3e6, "too many cells")
        x = np.zeros((2, int(np.prod(shape)), self.model.features))
        for f, (side, taken), at in zip(used, sides, np.indices(shape).reshape(len(shape), x.shape[1])):
            x[:, :, f] = side[:, taken][:, at]
        machine = Machine(self.block, x, self.has_isnan)
        for output, name in enumerate(entry["outputs"]):
            got = machine.values[name]
            got = machine.wide(got[2] if isinstance(got, tuple) else got)
            need(not np.any(got.d & UNDECIDED), "a comparison that is not decided")
            every = range(len(self.model.base)) if self.model.label else [output]
            want = np.array([np.broadcast_to(self.model.evaluate(x[0], n), x.shape[1]) for n in every])
            if self.model.label:
                want = [np.argmax(want, axis=0) if len(want) > 1 else want[0] > 0]
            want = np.asarray(want[0], float)
            need(np.array_equal(bits(got.a.astype(float)), bits(np.array([want] * 3))), "a cell is another number")

    def sums(self, entry):
        """Sums of trees: in each box of a leaf the term of the text is that leaf; the additions are the library's."""
        model = self.model
        order = [(t, c) for t, (*_, outputs) in enumerate(model.trees) for c in range(len(outputs))]
        boxes = [model.boxes(t) for t in range(len(model.trees))]
        step, same, shape = 0, {}, None
        owner = np.repeat(np.arange(len(boxes)), [len(b[3]) for b in boxes])
        low, high, nan, leaf = (np.concatenate([b[i] for b in boxes]) for i in range(4))
        for f, steps in enumerate(self.steps):
            if len(steps):
                owner, low, high, nan, leaf = self.parts(f, owner, low, high, nan, leaf)
        for step in range(0, len(owner), 100_000):
            part = slice(step, step + 100_000)
            free = (low[part] > high[part]) & ~nan[part]
            ends = (model.first_key, low), (model.last_key, high)
            x = np.array([numbers(np.where(free, everything, side[part])) for everything, side in ends])
            x = np.where(nan[part], np.nan, x)
            x = np.concatenate([x, np.where(free & model.nan, np.nan, x[:1])])
            machine = Machine(self.block, x, self.has_isnan, self.profiles)
            outs = [machine.values[name] for name in entry["outputs"]]
            shape = [(o[2] if isinstance(o, tuple) else o) for o in outs]
            at = 0
            for t, c in order:
                values = model.trees[t][5][:, c]
                if np.all(bits(values) == bits(values[:1])):
                    same[t, c] = float(values[0])
                    continue
                need(at < len(machine.terms), "the text has too few terms")
                mine, term = owner[part] == t, machine.terms[at]
                at += 1
                need(not np.any(term.d[mine] & UNDECIDED), f"tree {t}: a comparison that is not decided")
                want, got = np.array([values[leaf[part][mine]]] * 3), term.a[:, mine].astype(float)
                need(np.array_equal(bits(got), bits(want)), f"tree {t} differs")
            need(at == len(machine.terms), "the text has more terms than the model has trees")
        names = {key: ("term", i) for i, key in enumerate(k for k in order if k not in same)}
        wanted = [self.total(output, names, same) for output in range(len(model.base))]
        if model.label:  # the first of the largest, or where the only score is above zero
            zero, one = (("const", number.hex()) for number in (0.0, 1.0))
            largest, best = wanted[0], zero if len(wanted) > 1 else ("if", ("greater", wanted[0], zero), one, zero)
            for number, score in enumerate(wanted[1:], 1):
                larger = "greater", score, largest
                largest, best = ("if", larger, score, largest), ("if", larger, ("const", float(number).hex()), best)
            wanted = [best]
        for got, want in zip(shape, wanted, strict=True):
            need(isinstance(got, Sum), "an output that is no sum")
            need(self.normal(got.key) == self.normal(want), "other operations than the model's")

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


def has_isnan(folder):
    """Whether the text tests NaN by the bits, in the one way that is known."""
    texts = [" ".join(text.split()) for text in codes(folder)]
    return all(any(re.fullmatch(form.replace("\n", " "), text) for text in texts) for form in (ISNAN, UNION))


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
TEXTS = {".st", ".scl", ".TcPOU", ".TcDUT", ".TcGVL", ".xml"}


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def names_class(entry):
    """Whether the only output is the number of a class: names of whole numbers begin with n, all others with f."""
    return [name[:1] for name in entry["outputs"]] == ["n"]


def unchecked(entry):
    """Why an entry is not checked here; None for one that is."""
    if entry["verdict"] in ("not proved", "refuted") and entry.keys() == UNPROVED:
        return f"{entry['verdict']}, by its own words"
    method = entry.get("method")
    expression = entry["verdict"] == "proved" and method in EXPRESSIONS and entry.keys() - {"bound"} == ENTRY
    need(expression or (entry["verdict"] == "proved" and entry.keys() == ENTRY), "another form of entry")
    if expression and (method != BY_CLASS or not names_class(entry)):
        return "not checked: expressions are outside of this checker"
    if entry["outputs"][0].startswith("n") and len(entry["outputs"]) > 1:
        return "not checked: chances and scores of classes are outside of this checker"
    return None


def limit(model, entry, ranges, given):
    """Number the inputs as the block's are, and take the limits that bundle.toml or st-codegen.toml give them."""
    names = model.names or [f"f{number}" for number in range(model.features)]
    if ranges is not None:
        need([r["name"] for r in ranges] == entry["inputs"], "other inputs than those of the bundle")
        if model.names and sorted(model.names) == sorted(entry["inputs"]):
            model.order(model.names, entry["inputs"])
    else:
        need(entry["inputs"] == names, "other inputs than those of the model")
        said = [r for r in given if r.get("file", "") in ("", entry["file"])]
        ranges = [next((r for r in said[::-1] if r["feature"] == name), {}) for name in names]
        ranges = [r if r.get("outside", "clamp") == "clamp" else {} for r in ranges]
    for side, far, bound in (("min", -np.inf, model.lower), ("max", np.inf, model.upper)):
        bound[:] = [float(r.get(side, far)) for r in ranges]


def main(certificate, models, out):
    """Say of each entry if it is confirmed; how many are, of how many. Raises Reject for one that does not hold."""
    content = json.loads(Path(certificate).read_text("utf-8"))
    models, out = Path(models), Path(out)
    folder = models if models.is_dir() else models.parent
    need(content.keys() == PARTS and content["format"] == "st-codegen certificate 1", "another format")
    need(content["statement"] == STATEMENT and content["assumptions"] == ASSUMPTIONS, "another statement")
    proofs, bundle, settings = content["proofs"], folder / "bundle.toml", folder / "st-codegen.toml"
    files = {e["file"] for e in proofs} | {path.name for path in (bundle, settings) if path.is_file()}
    need(content["models"] == {name: sha256(folder / name) for name in files}, "other model files")
    targets = {name: out / name if (out / name).is_dir() else out for name in content["texts"]}
    for target, path in targets.items():
        texts = {p.relative_to(path).as_posix(): sha256(p) for p in path.rglob("*") if p.suffix in TEXTS}
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
            called = Path(entry["file"]).stem, entry["block"].lower()  # a prefix or a given name is in the block's, too
            need(entry["model"] == called[0] or f"fb_{entry['model']}".lower() == called[1], "another file")
            other = unchecked(entry)
            try:
                model = other or read_model(folder / entry["file"])
                need(other or model.label == names_class(entry), "a decision of another kind")
            except Reject as outside:
                other = f"not checked: {outside}"
            if other:
                print(f"{where}: {other}")
                continue
            limit(model, entry, ranges, given)
            found = Check(model, targets[entry["target"]], entry)
            need((found.method, found.trees) == (entry["method"], entry["trees"]), "proved in another way")
        except Reject as reason:
            raise Reject(f"{where}: {reason}") from None
        confirmed += 1
        print(f"{where}: confirmed")
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
        print(f"accepted: all {every} entries are confirmed")
        sys.exit(0)
    print(f"accepted in part only: {done} of {every} entries are confirmed, {every - done} are not")
    sys.exit(3)
