"""From logs to slip laws with intervals: `identify` does it all in one call.

For whole drives, read these files in this order:

- `source` reads logs; `trackslip.drives` makes clean drives of them and inspects these.
- `drive_comparison` fits and compares laws: its function `compare_drives` is the method, step by
  step.
- `law_fit` fits a law: length of windows, start values (by `far_poses` if poses are rare), and what
  the driving doesn't determine.
- `windows` is the estimator: residuals of poses, robust fit, standard errors. `path` is its model:
  the sensor's path by the law, with derivatives.
- `prediction` predicts held-out driving; `longer_windows` asks whether the law depends on the
  length of windows.

For steady runs, `samples` averages slip and `steady` fits laws to the averages.

`comparison` (the choice of the best law), `answer` (the multipliers) and `result` (what is returned
and stored) serve both kinds of runs.
"""
