"""Raw records made into clean drives, and a first look at them before any law is fitted.

`conditioning` makes the drives in logs: `encoders`, `poses` and `gyro` each have the rules for one
sensor, and `drive` has the result, also for several drives in succession.

`first_look` inspects drives. `clocks` aligns encoders and poses, `gains` compares their distances
and turns in windows, `relative_motions` compares them from pose to pose where poses are rare,
`misread` finds columns with wrong data by both comparisons, and `jumps` cuts drives where their
poses jump. `checks` has the verdicts: a check holds, fails, or can't be told from the log.
"""
