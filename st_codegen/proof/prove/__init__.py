"""Proof for all inputs: the emitted text is executed on boxes of inputs, and compared with the model file."""
