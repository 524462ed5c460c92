"""What chains ask for: searches, fits and proofs, one by one or those of many plans together."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxplan.certificate import Report
from jaxplan.planner.chain import Query, Question
from jaxplan.planner.check import ProofQuery, prove_batch
from jaxplan.planner.clock import Clock
from jaxplan.runtime.batching import Seconds
from jaxplan.runtime.stopwatch import working_time
from jaxplan.search import PLANNERS, SearchResult, search_batch
from jaxplan.trajectory import Fit, FitQuery, fit_batch

Answer = SearchResult | Fit | Report

_STEPS: dict[type, str] = {Query: "search", FitQuery: "trajectory", ProofQuery: "certificate"}


def answer(question: Question, clock: Clock) -> Answer:
    """The answer to one question, and the time it took to the clock."""
    with clock.step(_STEPS[type(question)]):
        if isinstance(question, Query):
            return PLANNERS[question.settings.method](question.scene, question.settings)
        return _many([question], np.zeros(1))[0]


def answers(asked: Sequence[tuple[Question, Clock]]) -> list[Answer]:
    """The answers to the questions, those of a step together, and the time they took to the clocks."""
    found: dict[int, Answer] = {}
    for kind, step in _STEPS.items():
        numbers = [number for number, (question, _) in enumerate(asked) if isinstance(question, kind)]
        if numbers:
            found.update(zip(numbers, _together([asked[number] for number in numbers], step), strict=True))
    return [found[number] for number in range(len(asked))]


def _together(asked: Sequence[tuple[Question, Clock]], step: str) -> list[Answer]:
    """The answers to questions of one step; to each clock its share of the time."""
    begin, began = time.monotonic(), working_time()
    spent = np.zeros(len(asked))
    found = _many([question for question, _ in asked], spent)
    wall, working = time.monotonic() - begin, working_time() - began
    spent += (working - np.sum(spent)) / len(spent)  # what is nobody's own
    for (_, clock), own in zip(asked, spent.tolist(), strict=True):
        clock.add(step, own + (wall - working) / len(spent), own)
    return found


def _many(questions: Sequence[Any], spent: np.ndarray) -> list[Answer]:
    """The answers to questions of one kind; the seconds of each are added to `spent` where they are known."""
    if isinstance(questions[0], Query):
        return [*search_batch([one.scene for one in questions], [one.settings for one in questions], spent)]
    if isinstance(questions[0], FitQuery):
        seconds = Seconds(len(questions))
        fits = fit_batch(questions, seconds)
        spent += seconds.spent
        return [*fits]
    return [*prove_batch(questions)]
