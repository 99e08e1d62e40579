"""Mistakes of measuring, looked for before any effect: units, labels, zeros, sensors, filters."""
