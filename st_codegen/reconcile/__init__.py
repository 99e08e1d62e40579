"""Fit a rig model to measured data and name what it lacks.

From the floor up: `data` reads what was measured and tells its noise; `fit` fits a rig; `mistakes` asks about what was
read wrong before anything is fitted; `rest` tells structure from noise in what a fit leaves; `search` adds effects one
by one; `judge` says what stands in the end. `run` leads through these, `plan`, `models` and `report` use its result.
`spectrum` and `joint` stand for themselves: order spectra without phases, and recordings of a robot's joints.
"""
