"""Identification: from logs to slip laws with intervals.

`source` reads logs. Whole drives: `preparation` says what encoders and poses are worth; `first_look` checks them by
`clocks`, `misread` and `gains`; `windows` fit the model of `path`, and `law_fit` a law by them; `prediction` says how
far off laws are. Steady runs: `samples` and `steady`. Both: `comparison`, `result`, and `identify`, all in one call.
"""
