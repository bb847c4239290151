"""Identification: from logs to slip laws with intervals.

`source` reads logs. For whole drives, `preparation` extracts encoder intervals and poses; `first_look` checks drives by
means of `clocks`, `misread` and `gains`; `law_fit` fits laws by means of `windows` and `path`; `prediction` tests laws.
For steady runs, `samples` averages slip, `steady` fits laws. Both use `comparison` and `result`. `identify` runs it all.
"""
