"""The dialects and kinds of files that can be written: each module of this folder enters one target into the table.

A room of its own (such as `beckhoff_ml`) enters its target when it is imported.
"""

import importlib
import pkgutil

from st_codegen.emit.targets.base import TARGETS, FilePlan, Target, enter_target, target_named

for _module in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{_module.name}")

__all__ = ["TARGETS", "FilePlan", "Target", "enter_target", "target_named"]
