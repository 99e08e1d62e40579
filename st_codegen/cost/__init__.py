"""The cost model: the worst case of emitted text, counted on its checked tree and priced by a profile of the machine.

    profile = load_profile("cx5140")
    cost = project_cost(load_project(["generated/twincat"]), profile)
    cost.fits(250.0)

It judges the text as `verify` does, and knows nothing of what the text was made from.
"""
