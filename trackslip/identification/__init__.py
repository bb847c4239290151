"""Identification: from logs to slip laws with intervals.

`source` reads logs. For whole drives, `preparation` extracts encoder intervals and poses; `first_look` checks them with
`clocks`, `misread` and `gains`; `windows` fits the model in `path`, and `law_fit` a law with it; `prediction` measures
errors of laws. For steady runs: `samples`, `steady`. For both: `comparison`, `result`, and `identify`, all in one call.
"""
