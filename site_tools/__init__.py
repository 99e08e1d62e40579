"""What makes the documentation: its pictures, and the pages that are read from the code."""
