"""A blind suite of `st-codegen reconcile` whose hidden physics is not that of the program's own catalogue of effects.

The generators follow textbooks and papers, named beside each; none follows the formulas of the program. Known parts of
a machine are simulated by the program, from a rig.toml that reconcile is given; what is added on top is made here.
"""
