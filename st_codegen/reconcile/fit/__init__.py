"""The joint fit of all parameters of a rig: coordinates, how effects reach what is measured, Gauss-Newton."""
