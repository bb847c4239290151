"""Identification: from logs to slip laws with intervals.

`source` reads logs. Whole drives: `preparation` says what encoders and poses are worth; `first_look` checks them by
`clocks`, `misread`, `gains` and `jumps`; `windows` fit the model of `path`, and `law_fit` a law by them; `prediction`
says how far off laws are, and `comparison` which is best. Steady runs: `samples` of them, `steady_fit`, and
`steady_comparison`. Both: `fitted` values with intervals, `result`, and `identify`, the whole in one call.
"""
