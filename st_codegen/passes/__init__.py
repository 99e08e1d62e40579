"""Exact rewrites of the intermediate representation, and the analyses that they need."""
