"""Raw records made into clean drives, and a first look at them before any law is fitted.

`conditioning` makes the drives in logs: `encoders`, `poses` and `gyro` each have the rules for one
sensor, and `drive` has the result, also for several drives in succession. `first_look` inspects
drives: `clocks` aligns encoders and poses, `gains` compares their distances and turns, `misread`
finds columns with wrong data, and `jumps` cuts drives where their poses jump.
"""
