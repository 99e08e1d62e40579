"""Find where a rig model and measured data disagree, name the effect that is missing, and add it."""
