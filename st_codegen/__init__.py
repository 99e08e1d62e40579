"""Compiles trained models to IEC 61131-3 Structured Text and proves that the code computes the same numbers."""

__version__ = "0.1.0"
