"""From files to the syntax tree."""
