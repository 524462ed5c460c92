"""Monte-Carlo studies: many scenes planned, by one process or many, with a table that is always the same.

    >>> study = jp.run_study(range(1000), "hard_keep_out", workers=2, out="study")
    >>> print(study.summary())

`task` says what a study plans and cuts it up, `run` shares it out, `rows` are what comes of it, which `store`
keeps; `result` and `comparison` say what they mean. The studies of `table4` search alone.
"""

from jaxplan.study.comparison import Comparison, compare_studies
from jaxplan.study.folder import StudyFolderError
from jaxplan.study.result import Study, Summary, load_study
from jaxplan.study.run import run_study

__all__ = [
    "Comparison",
    "Study",
    "StudyFolderError",
    "Summary",
    "compare_studies",
    "load_study",
    "run_study",
]
