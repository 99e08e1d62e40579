"""Back to the controller: what was found as terms of a bundle of models."""
