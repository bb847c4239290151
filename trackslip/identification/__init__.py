"""Identification: from logs to slip laws with intervals.

Data: `source` reads logs; `samples` are steady stretches, `drives` whole drives; `plausibility`, `sensor` and
`outliers` check both. Fits: `steady_fit` fits samples with `weighting` and the batched `solver`; `drive_fit` fits the
trajectory and the law of drives together, with `drive_model`, `drive_residuals`, `drive_equations` and `drive_start`.
`fitted` and `drive_law` describe one fitted law each, with `intervals`, `determined` and `lack_of_fit`. `comparison`
compares laws by their `prediction` and lists `doubts`; `identify` is the whole in one call, `result` what it returns.
"""
