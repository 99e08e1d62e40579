"""Compiles trained models to IEC 61131-3 Structured Text and proves that the code computes the same numbers.

>>> import st_codegen
>>> bundle = st_codegen.load("models")
>>> st_codegen.generate(bundle, "twincat", "generated")
>>> st_codegen.verify(bundle, "generated").passed
True
>>> st_codegen.diff("generated of yesterday", "generated").changed
True
"""

__version__ = "0.1.0"

from st_codegen.bundle import load
from st_codegen.generate import generate
from st_codegen.review import diff
from st_codegen.verify import verify

__all__ = ["diff", "generate", "load", "verify"]
