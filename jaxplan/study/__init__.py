"""Monte-Carlo studies: many scenes planned by one or many processes, with the same table on every run.

    >>> study = jp.run_study(range(1000), "hard_keep_out", workers=2, out="study")
    >>> print(study.summary())

`task` defines what a study plans and divides it into blocks and chunks, `run` hands these to workers, `rows`
makes table rows of the plans, and `store` keeps the rows on disk. `result` and `comparison` summarize them.
`printed_planners` runs studies that search for paths only, without planning the motion along them.
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
