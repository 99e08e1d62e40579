"""Many axes: each is trained, compiled, proved and reconciled; then they are compared with each other and with before.

`axes` reads fleet.toml, `stages` does one axis, `run` all of them, `compare` and `growth` look across, `output` writes.
"""
