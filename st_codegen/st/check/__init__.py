"""From the syntax tree to typed units: names, types, conversions, flow."""
