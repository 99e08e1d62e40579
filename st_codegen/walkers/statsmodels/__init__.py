"""Walkers of statsmodels: linear and generalized linear models, from trusted pickles."""
