"""From logs to slip laws with intervals: `identify` does it all in one call.

`source` reads logs. For whole drives, `trackslip.drives` makes clean drives and inspects them;
`law_fit` fits laws by means of `windows` and `path`, from start values by `far_poses` if poses are
rare; `prediction` tests laws. For steady runs, `samples` averages slip and `steady` fits laws.
`comparison`, `answer` (the multipliers) and `result` serve both kinds of runs.
"""
