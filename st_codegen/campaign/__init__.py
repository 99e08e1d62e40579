"""The measured data: curves of the transmission error, their orders, and harmonic tables."""
