"""What is written: report.json, rig.toml, the page, its maps and sentences."""
