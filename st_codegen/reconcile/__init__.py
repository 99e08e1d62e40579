"""Find where a rig model and measured data disagree, name the effect that is missing, and add it.

From the floor up: `data` reads what was measured and tells its noise; `fit` fits a rig; `mistakes` asks about what was
read wrong before anything is fitted; `rest` tells structure from noise in what a fit leaves; `search` adds effects one
by one; `judge` says what stands in the end. `core` leads through these, `run` reads data for it until nothing has to be
asked, and `plan`, `models` and `report` use the `result`.

`spectrum` and `joint` stand for themselves: order spectra without phases, and recordings of a robot's joints.
"""
