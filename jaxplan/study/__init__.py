"""Monte-Carlo studies: many scenes planned, by one process or many, with a table that is always the same.

    >>> study = jp.run_study(range(1000), "hard_keep_out", workers=2, out="study")
    >>> print(study.summary())

`task` says what a study plans, `chunks` cuts it up, `work` plans a chunk, `engine` shares the chunks out,
`store` keeps the rows, and `result`, `summary` and `comparison` say what they mean.
"""

from jaxplan.study.comparison import Comparison, compare_studies
from jaxplan.study.lines import StudyFolderError
from jaxplan.study.result import Study, load_study
from jaxplan.study.run import run_study
from jaxplan.study.summary import Summary

__all__ = [
    "Comparison",
    "Study",
    "StudyFolderError",
    "Summary",
    "compare_studies",
    "load_study",
    "run_study",
]
