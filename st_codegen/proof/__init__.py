"""That the generated text computes what the library does."""
