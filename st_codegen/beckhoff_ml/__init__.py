"""The target for TwinCAT's machine learning runtime, and the reader of its model files."""
