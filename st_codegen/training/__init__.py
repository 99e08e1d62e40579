"""From a harmonic table to a bundle: families, search, choice, tables, export."""
