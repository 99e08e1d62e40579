"""How every room reads and writes files: text, TOML tables, CSV tables, and results that appear whole or not at all."""
