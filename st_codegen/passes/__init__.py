"""Rewrites of the intermediate representation, and the analyses that they need.

All are exact but those of `kernels` and `real`, of which the bound that `verify` states holds the rounding.
"""
