from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

import jaxplan as jp
from jaxplan.derivatives import follow_and_hold, following, held
from jaxplan.runtime.workers import _openblas_libraries, one_thread


def numbers() -> list[int]:
    return [get() for get, _ in _openblas_libraries()]


@pytest.fixture
def two_threads():
    if not _openblas_libraries():
        pytest.skip("numpy and scipy are built without OpenBLAS here")
    before = numbers()
    for _, set_number in _openblas_libraries():
        set_number(2)
    yield
    for (_, set_number), number in zip(_openblas_libraries(), before, strict=True):
        set_number(number)


def test_there_is_one_thread_inside_and_the_same_number_as_before_outside(two_threads):
    assert set(numbers()) == {2}
    with one_thread(), one_thread():
        assert set(numbers()) == {1}
    assert set(numbers()) == {2}
    with pytest.raises(ZeroDivisionError), one_thread():
        raise ZeroDivisionError
    assert set(numbers()) == {2}


def test_the_last_of_several_to_leave_puts_the_number_back(two_threads):
    def see(_):
        with one_thread():
            return set(numbers())

    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(see, range(200))) == [{1}] * 200
    assert set(numbers()) == {2}


def test_plans_are_held_and_followed_with_one_thread(two_threads, monkeypatch):
    seen = []

    def look(*_):
        seen.append(set(numbers()))
        raise ZeroDivisionError

    monkeypatch.setattr(held, "followed_by", look)
    monkeypatch.setattr(following, "find_goals", look)
    scenario = jp.paper_case(1)
    plan = jp.Plan(scenario=scenario, status=jp.Status.OK, path=SimpleNamespace(edges=1), goal=())
    with pytest.raises(ZeroDivisionError):
        jp.hold(plan)
    for follow in (jp.follow, follow_and_hold):
        with pytest.raises(ZeroDivisionError):
            follow(plan, scenario)
    assert seen == [{1}] * 3
