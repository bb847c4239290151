"""From logs to slip laws with intervals: `identify` does it all in one call.

`source` reads logs. For whole drives, `preparation` extracts encoder intervals and poses;
`first_look` checks drives by means of `clocks`, `misread` and `gains`; `law_fit` fits laws by means
of `windows` and `path`, from start values by `far_poses` if poses are rare; `prediction` tests
laws. For steady runs, `samples` averages slip and `steady` fits laws. `comparison`, `answer` (the
multipliers) and `result` serve both kinds of runs.
"""
