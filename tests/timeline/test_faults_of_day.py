"""What could not be proved of a part, told in the times of the day."""

import pytest
from builders import make_plan

from jaxplan import planner
from jaxplan.certificate import Certificate, faults_later
from jaxplan.timeline.proving import merged


def proof(*faults: str) -> Certificate:
    return Certificate(certified=not faults, peaks={}, peak_times={}, jumps={}, faults=faults)


def test_times_of_faults_are_those_of_the_day():
    found = faults_later(
        proof(
            "telescope enters sun by 1.5 deg at t = 3.25 s",
            "the margin of antenna to mask is not proved: 0.1 deg was met at t = 1.5e-05 s",
            "robust leaves nothing of the range of yaw",
        ),
        4000.5,
    )
    assert found == [
        "telescope enters sun by 1.5 deg at 4003.75 s",
        "the margin of antenna to mask is not proved: 0.1 deg was met at 4000.50 s",
        "robust leaves nothing of the range of yaw",
    ]


def test_faults_of_a_merged_certificate_tell_the_instant_and_the_part():
    only = merged([(120.0, None, proof("rate reaches 2 deg/s at t = 10 s"))])
    assert not only.certified
    assert only.faults == ("rate reaches 2 deg/s at 130.00 s, in the part that begins at 120.00 s",)


def test_the_times_that_a_certificate_tells_are_all_moved():
    hasty = make_plan(1, duration=2.0)
    found = planner.certify(hasty)
    told = [fault for fault in found.faults if " at t = " in fault]
    assert told, found.faults
    for fault, before in zip(faults_later(found, 1000.0), found.faults, strict=True):
        assert " at t = " not in fault
        if before in told:
            own, moved = (
                float(text.rsplit(" at ", 1)[1].removeprefix("t = ").split()[0]) for text in (before, fault)
            )
            assert moved == pytest.approx(1000.0 + own, abs=0.01)
