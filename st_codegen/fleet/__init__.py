"""Many axes: each is trained, compiled, proved and reconciled; then they are compared with each other and with before.

`axes` reads fleet.toml, `stages` does one axis, with the models of `shared` where several have the same, `run` all of
them. `estimates` has what a campaign says of each parameter, `compare` looks across, `records` knows what is done
already, `output` writes.
"""
