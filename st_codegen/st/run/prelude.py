"""The part of the code that is the same for every project: rare cases of operations, and calls of native code."""

from __future__ import annotations

from st_codegen.st.check import arithmetic as a
from st_codegen.st.run.writer import INFINITY, KINDS

#: Functions of the C library by the names that code calls them; not the usual names, which optimisers know.
C_FUNCTIONS = {name: name.lower() for name in ("EXP", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "ATAN2")}
C_FUNCTIONS |= {"LN": "log", "LOG": "log10", "EXPT": "pow"}

#: Entries of the context, 64 bits each: the fault, where the run is, and how native code is called.
CONTEXT = (
    *("kind", "site", "first", "second"),
    *("row", "frame", "frames", "frame_bytes", "program", "programs", "program_bytes"),
    *("host", "is_trial", "calls", "missed", "answers", "answer_bytes", "answers_a_row", "known", "begin", "status"),
)


def context_entry(name: str) -> str:
    """The address of an entry of the context, as an expression of constants."""
    return f"getelementptr inbounds i64, ptr %c, i64 {CONTEXT.index(name)}"


def _load(name: str, kind: str, entry: str) -> str:
    """The value of an entry of the context; its address is the name behind a `p.`."""
    return f"%p.{name} = {context_entry(entry)}\n  %{name} = load {kind}, ptr %p.{name}"


def _store(value: str, entry: str) -> str:
    return f"%p.{entry} = {context_entry(entry)}\n  store i64 {value}, ptr %p.{entry}"


def _fault(kind: str, y: str = "%y") -> str:
    return f"call void @fault(ptr %c, i64 {KINDS.index(kind)}, i64 %site, i64 %x, i64 {y})"


#: What every module begins with.
INTRINSICS = """declare double @llvm.fabs.f64(double)
declare float @llvm.fabs.f32(float)
declare double @llvm.sqrt.f64(double)
declare double @llvm.rint.f64(double)
declare double @llvm.trunc.f64(double)
declare double @llvm.floor.f64(double)
declare void @llvm.memmove.p0.p0.i64(ptr, ptr, i64, i1)
declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)
attributes #0 = { cold nounwind }
attributes #1 = { nounwind willreturn memory(none) }
!0 = !{}
"""
#: GETCPUCOUNTER of Tc2_System where the C library has a clock: a block of a library that is called as often as the
#: code it times, and so is machine code itself. Both halves of the count are one number in memory.
CLOCK = """
declare i32 @clock_gettime(i32, ptr)
define i32 @block.GETCPUCOUNTER(ptr %c, ptr %g, ptr %s) {
  %t = alloca [2 x i64]
  %r = call i32 @clock_gettime(i32 1, ptr %t)
  %seconds = load i64, ptr %t
  %p = getelementptr i64, ptr %t, i64 1
  %ns = load i64, ptr %p
  %whole = mul i64 %seconds, 10000000
  %part = udiv i64 %ns, 100
  %units = add i64 %whole, %part
  store i64 %units, ptr %s, align 4
  ret i32 0
}
"""
#: Functions of the prelude that units call, and the one that runs rows.
EXPORTED = ("fault", "check.64", "check.32", "check.power", "domain", "native", "rows")

_HEAD = f"""
define void @fault(ptr %c, i64 %kind, i64 %site, i64 %x, i64 %y) cold noinline {{
  store i64 %kind, ptr %c
  {_store("%site", "site")}
  {_store("%x", "first")}
  {_store("%y", "second")}
  ret void
}}
"""

# Of an operation whose result is not finite: whether a processor with its traps on would stop
_REAL = """
define i1 @check.{bits}(ptr %c, i64 %site, {T} %r, {T} %a, {T} %b, i1 %division) cold noinline {{
  %x{n} = bitcast {T} %a to i{bits}
  %y{n} = bitcast {T} %b to i{bits}
  {widened}
  %sx = call i1 @signalling.{bits}({T} %a)
  %sy = call i1 @signalling.{bits}({T} %b)
  %s = or i1 %sx, %sy
  br i1 %s, label %invalid, label %quiet
quiet:
  %nan = fcmp uno {T} %a, %b
  br i1 %nan, label %fine, label %numbers
numbers:
  %fa = call {T} @llvm.fabs.f{bits}({T} %a)
  %fb = call {T} @llvm.fabs.f{bits}({T} %b)
  %ia = fcmp oeq {T} %fa, {inf}
  %ib = fcmp oeq {T} %fb, {inf}
  %zero = fcmp oeq {T} %b, 0.0
  %by_zero = and i1 %division, %zero
  br i1 %by_zero, label %divided, label %others
divided:
  br i1 %ia, label %fine, label %division.by.zero
others:
  %made = fcmp uno {T} %r, %r
  br i1 %made, label %invalid, label %large
large:
  %i = or i1 %ia, %ib
  br i1 %i, label %fine, label %overflow
invalid:
  {invalid}
  ret i1 true
division.by.zero:
  {division}
  ret i1 true
overflow:
  {overflow}
  ret i1 true
fine:
  ret i1 false
}}
define internal i1 @signalling.{bits}({T} %a) {{
  %n = fcmp uno {T} %a, %a
  %u = bitcast {T} %a to i{bits}
  %q = and i{bits} %u, {quiet}
  %z = icmp eq i{bits} %q, 0
  %r = and i1 %n, %z
  ret i1 %r
}}
"""


def _real(bits: int) -> str:
    widened = "" if bits == 64 else "%x = zext i32 %xn to i64\n  %y = zext i32 %yn to i64"
    return _REAL.format(
        bits=bits,
        T="double" if bits == 64 else "float",
        n="" if bits == 64 else "n",
        widened=widened,
        inf=INFINITY,
        quiet=1 << (51 if bits == 64 else 22),
        invalid=_fault(a.INVALID),
        division=_fault(a.DIVISION),
        overflow=_fault(a.OVERFLOW),
    )


_FUNCTIONS = f"""
define i1 @domain(ptr %c, i64 %site, i64 %kind, double %a) cold noinline {{
  %x = bitcast double %a to i64
  %nan = fcmp uno double %a, %a
  br i1 %nan, label %not, label %outside
not:
  %s = call i1 @signalling.64(double %a)
  br i1 %s, label %invalid, label %fine
outside:
  call void @fault(ptr %c, i64 %kind, i64 %site, i64 %x, i64 0)
  ret i1 true
invalid:
  {_fault(a.INVALID, y="0")}
  ret i1 true
fine:
  ret i1 false
}}
define i1 @check.power(ptr %c, i64 %site, double %r, double %a, double %b) cold noinline {{
  %x = bitcast double %a to i64
  %y = bitcast double %b to i64
  %fa = call double @llvm.fabs.f64(double %a)
  %fb = call double @llvm.fabs.f64(double %b)
  %af = fcmp olt double %fa, {INFINITY}
  %bf = fcmp olt double %fb, {INFINITY}
  %a0 = fcmp oeq double %a, 0.0
  %bn = fcmp olt double %b, 0.0
  %d1 = and i1 %a0, %bn
  %d = and i1 %d1, %bf
  br i1 %d, label %division, label %root
root:
  %an = fcmp olt double %a, 0.0
  %whole = call double @llvm.floor.f64(double %b)
  %broken = fcmp one double %b, %whole
  %i1 = and i1 %an, %af
  %i2 = and i1 %i1, %bf
  %i = and i1 %i2, %broken
  br i1 %i, label %invalid, label %size
size:
  %fr = call double @llvm.fabs.f64(double %r)
  %rf = fcmp olt double %fr, {INFINITY}
  %nan = fcmp uno double %a, %b
  %fine = or i1 %rf, %nan
  br i1 %fine, label %good, label %look
look:
  %stops = call i1 @check.64(ptr %c, i64 %site, double %r, double %a, double %b, i1 false)
  ret i1 %stops
division:
  {_fault(a.DIVISION)}
  ret i1 true
invalid:
  {_fault(a.INVALID)}
  ret i1 true
good:
  ret i1 false
}}
"""

# Calls of native code. Ordinary calls go to the host. In a trial, answers that the host gave to the same questions of
# the row before are taken; a question without an answer is noted, and the run goes on as if nothing were answered.
_NATIVE = f"""
define i32 @native(ptr %c, i64 %site, ptr %frame, i64 %size) noinline {{
  {_load("trial", "i64", "is_trial")}
  %is = icmp ne i64 %trial, 0
  br i1 %is, label %tried, label %direct
direct:
  {_load("host", "ptr", "host")}
  {_load("row", "i64", "row")}
  %status = call i32 %host(i64 %row, i64 %site, ptr %frame)
  ret i32 %status
tried:
  {_load("k", "i64", "calls")}
  %k1 = add i64 %k, 1
  store i64 %k1, ptr %p.k
  {_load("n", "i64", "answers_a_row")}
  %pm = {context_entry("missed")}
  %room = icmp ult i64 %k, %n
  br i1 %room, label %look, label %miss
look:
  {_load("row2", "i64", "row")}
  {_load("begin", "i64", "begin")}
  %local = sub i64 %row2, %begin
  %rk = mul i64 %local, %n
  %at = add i64 %rk, %k
  {_load("known", "ptr", "known")}
  %mark = getelementptr i64, ptr %known, i64 %at
  {_load("answers", "ptr", "answers")}
  {_load("bytes", "i64", "answer_bytes")}
  %twice = mul i64 %bytes, 2
  %where = mul i64 %at, %twice
  %asked = getelementptr i8, ptr %answers, i64 %where
  %answer = getelementptr i8, ptr %asked, i64 %bytes
  %now = load i64, ptr %mark
  %mine = add i64 %site, 1
  %same = icmp eq i64 %now, %mine
  br i1 %same, label %compare, label %ask
compare:
  %i = phi i64 [ 0, %look ], [ %j, %equal ]
  %more = icmp ult i64 %i, %size
  br i1 %more, label %word, label %hit
word:
  %fp = getelementptr i8, ptr %frame, i64 %i
  %ap = getelementptr i8, ptr %asked, i64 %i
  %fw = load i64, ptr %fp
  %aw = load i64, ptr %ap
  %j = add i64 %i, 8
  %eq = icmp eq i64 %fw, %aw
  br i1 %eq, label %equal, label %ask
equal:
  br label %compare
hit:
  call void @llvm.memmove.p0.p0.i64(ptr %frame, ptr %answer, i64 %size, i1 false)
  ret i32 0
ask:
  call void @llvm.memmove.p0.p0.i64(ptr %asked, ptr %frame, i64 %size, i1 false)
  %open = sub i64 0, %mine
  store i64 %open, ptr %mark
  br label %miss
miss:
  store i64 1, ptr %pm
  ret i32 0
}}
"""

# Runs a unit for some rows, up to the first one that is stopped
_ROWS = f"""
define i64 @rows(ptr %c, ptr %one, ptr %g, i64 %gs, ptr %s, i64 %ss, i64 %first, i64 %last) {{
start:
  %pr = {context_entry("row")}
  %pf = {context_entry("frame")}
  {_load("frames", "ptr", "frames")}
  {_load("fs", "i64", "frame_bytes")}
  %pp = {context_entry("program")}
  {_load("programs", "ptr", "programs")}
  {_load("ps", "i64", "program_bytes")}
  {_load("trial", "i64", "is_trial")}
  %is = icmp ne i64 %trial, 0
  %pc = {context_entry("calls")}
  %pm = {context_entry("missed")}
  {_load("status", "ptr", "status")}
  {_load("begin", "i64", "begin")}
  br label %next
next:
  %r = phi i64 [ %first, %start ], [ %r1, %good ]
  %more = icmp slt i64 %r, %last
  br i1 %more, label %run, label %done
run:
  store i64 %r, ptr %pr
  store i64 0, ptr %pc
  store i64 0, ptr %pm
  %fo = mul i64 %r, %fs
  %f = getelementptr i8, ptr %frames, i64 %fo
  store ptr %f, ptr %pf
  %po = mul i64 %r, %ps
  %p = getelementptr i8, ptr %programs, i64 %po
  store ptr %p, ptr %pp
  %go = mul i64 %r, %gs
  %gr = getelementptr i8, ptr %g, i64 %go
  %so = mul i64 %r, %ss
  %sr = getelementptr i8, ptr %s, i64 %so
  %e = call i32 %one(ptr %c, ptr %gr, ptr %sr)
  %m = load i64, ptr %pm
  %missed = icmp ne i64 %m, 0
  br i1 %is, label %note, label %plain
note:
  %here = sub i64 %r, %begin
  %pw = getelementptr i8, ptr %status, i64 %here
  %mw = trunc i64 %m to i8
  store i8 %mw, ptr %pw
  br i1 %missed, label %good, label %plain
plain:
  %bad = icmp ne i32 %e, 0
  br i1 %bad, label %stopped, label %good
good:
  %r1 = add i64 %r, 1
  br label %next
stopped:
  ret i64 %r
done:
  ret i64 -1
}}
"""

TEXT = INTRINSICS + _HEAD + _real(64) + _real(32) + _FUNCTIONS + _NATIVE + _ROWS
