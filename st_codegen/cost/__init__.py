"""The cost model: the worst case of emitted text, counted on its checked tree and priced by a profile of the machine.

    profile = load_profile("cx5140")
    cost = project_cost(load_project(["generated/twincat"]), profile)
    cost.fits(250.0)

It judges the text as `verify` does, and knows nothing of what the text was made from.
"""

from st_codegen.cost.calibrate import Calibration, Measurement, calibrate, read_measurements, with_factors
from st_codegen.cost.operations import Operation
from st_codegen.cost.profile import DEFAULT, Profile, load_profile, profile_names
from st_codegen.cost.report import BlockCost, ProjectCost, UnitPart, project_cost

__all__ = [
    "DEFAULT",
    "BlockCost",
    "Calibration",
    "Measurement",
    "Operation",
    "Profile",
    "ProjectCost",
    "UnitPart",
    "calibrate",
    "load_profile",
    "profile_names",
    "project_cost",
    "read_measurements",
    "with_factors",
]
