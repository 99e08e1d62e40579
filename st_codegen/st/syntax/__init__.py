"""From files to declarations and their trees, names not resolved."""
