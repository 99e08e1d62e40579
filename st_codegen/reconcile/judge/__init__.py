"""From the last fit to what is said: claims, changed parameters, what is read wrong, and what else may be the cause."""
