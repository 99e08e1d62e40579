"""All that knows of transmission error: the bundle, its blocks, their check and the latency of the loop."""

from st_codegen.project.bundle import READERS
from st_codegen.te.bundle import read_bundle
from st_codegen.te.bundle_file import BUNDLE_FILE

READERS[BUNDLE_FILE] = read_bundle
