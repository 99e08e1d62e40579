"""Which operating points to measure next."""
