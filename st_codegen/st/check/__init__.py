"""From declarations to a checked project: names, types, conversions, flow."""
