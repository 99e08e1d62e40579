"""The simulated machine: effects, their sum, measured campaigns of it."""
