"""Measured data of every kind as complex harmonic coefficients, and what the data say about their own noise."""
