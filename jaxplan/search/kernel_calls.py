"""Kernel calls about one scene or many, and the runs that wait for them.

A *kernel* is a jitted function of a scene and some arrays. `Scenes` holds scenes of one layout (the same
array shapes), whose vectors are stacked on the device, so that calls about different scenes are answered in
one. A search with queues or trees is a `jaxplan.runtime.batching.Run` that asks for one `Call` after the
other; `Scenes.run` drives one run of each scene.

On the CPU the calls of a batch are a loop over the code of a single one, which saves the overhead of each
call and keeps its working set in the cache. On an accelerator they are computed side by side, where last
digits may differ.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.runtime.batching import Run, Seconds, in_groups, run_all
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import quick_jit
from jaxplan.search.scene import Layout, Scene

# Number of calls that are answered in one: few on the CPU, since few mostly wait and room for more costs
# time; on an accelerator as many as it computes side by side without taking longer. Fixed, so that kernels
# compile once.
CPU_CALLS, ACCELERATOR_CALLS = 8, 32
# Number of scenes that a stack has room for, fixed likewise.
POOL = 256

Item = TypeVar("Item")
Answer = TypeVar("Answer")


class Kernel:
    """A pure function of a scene and arrays to one array, jitted to answer several calls at once."""

    def __init__(self, function: Callable[..., Array]) -> None:
        self.__wrapped__ = function
        answers = partial(_evaluate_calls, function)
        answers.__name__ = _name_of(function)  # type: ignore[attr-defined]  # by which profiles name kernels
        self.answers = quick_jit(answers, level=1, static_argnames="layout")


def _name_of(function: Any) -> str:
    """Return the name of a function, also if it is a partial one."""
    return str(function.func.__name__ if isinstance(function, partial) else function.__name__)


def _evaluate_calls(
    function: Callable[..., Array],
    layout: Layout,
    scenes: Array,
    places: Array,
    count: Array,
    *arguments: Array,
) -> Array:
    """Return the answers (c, ...) of a kernel to c calls.

    Args:
        function: the function of the kernel.
        layout: layout of the scenes.
        scenes: (s, numbers) vectors of the s scenes.
        places: (c,) index of the scene that each call is about.
        count: how many of the calls, the first ones, are to be answered; on the CPU the answers to the others
            are zero.
        arguments: arguments of the calls, (c, ...) each.
    """

    def one(call: Array) -> Array:
        scene = layout.scene(scenes[places[call]])
        return function(scene, *(argument[call] for argument in arguments))

    if places.shape[0] == 1:  # XLA would take a loop over little for code that cannot call LAPACK
        return one(jnp.zeros((), int))[None]
    if jax.default_backend() != "cpu":
        return jax.vmap(one)(jnp.arange(places.shape[0]))
    shape = jax.eval_shape(one, 0)
    blank = jnp.zeros((places.shape[0], *shape.shape), shape.dtype)
    return jax.lax.fori_loop(0, count, lambda call, answers: answers.at[call].set(one(call)), blank)


@shown()
@dataclass(frozen=True, slots=True, eq=False)
class Call:
    """A kernel call about some scene.

    Attributes:
        kernel: the kernel to be called.
        arguments: numpy arrays or floats that the kernel takes beside the scene.
    """

    kernel: Kernel
    arguments: tuple[Any, ...]

    @property
    def kind(self) -> Hashable:
        """The kernel and the shapes of its arguments; calls of equal kinds are evaluated in one batch."""
        return self.kernel, tuple(np.shape(argument) for argument in self.arguments)


class SearchRun(Run, Protocol):
    """A search that asks for one kernel call after the other, and has its result once it asks for no more."""

    def result(self) -> Any:
        """Return the `SearchResult`, once there is no next request."""


class Scenes:
    """Scenes of one layout, with the answers of kernels about them and the time that each has taken.

    Attributes:
        scenes: all or some (see `part`) of the stacked scenes, in the order in which answers are given.
        seconds: computation time, s, that each of all stacked scenes has taken.
    """

    def __init__(self, scenes: Sequence[Scene]) -> None:
        self.scenes = list(scenes)
        self.seconds = Seconds(len(scenes))
        self._stack_places = list(range(len(scenes)))
        alone = len(scenes) == 1
        backend = jax.default_backend()
        self._max_calls = 1 if alone else CPU_CALLS if backend == "cpu" else ACCELERATOR_CALLS  # calls in one
        self._layout, first = scenes[0].packed
        vectors = np.zeros((1 if alone else POOL, len(first)))
        for place, scene in enumerate(scenes):
            vectors[place] = scene.packed[1]
        with jax.enable_x64(True):
            self._vectors = vectors if alone else jnp.asarray(vectors)

    def part(self, numbers: Sequence[int]) -> "Scenes":
        """Return the scenes of these numbers, which share the stack and the seconds of all."""
        some = object.__new__(Scenes)
        some.__dict__ |= self.__dict__
        some.scenes, some._stack_places = picked(self.scenes, numbers), picked(self._stack_places, numbers)
        return some

    def answers(self, calls: Sequence[Call]) -> list[np.ndarray]:
        """Answer one call about each scene, in order; each scene's share of the time goes to `seconds`."""
        asked = list(zip(self._stack_places, calls, strict=True))
        with jax.enable_x64(True), self.seconds.shared(self._stack_places):
            return in_groups(asked, lambda one: one[1].kind, self._answer_batch, most=self._max_calls)

    def run(self, runs: Sequence[Run]) -> None:
        """Drive runs to their ends, one for each of `scenes` in order; each run keeps its own result."""
        with jax.enable_x64(True):
            if len(runs) == 1:  # needs no order of calls, nor to share out the time
                with self.seconds.shared(self._stack_places):
                    while (call := runs[0].next_request()) is not None:
                        runs[0].accept(self._answer_batch([(self._stack_places[0], call)])[0])
                return
            own = Seconds(len(runs))
            run_all(runs, self._answer_numbered, most=self._max_calls, seconds=own)
            self.seconds.spent[self._stack_places] += own.spent

    def _answer_numbered(self, numbers: Sequence[int], calls: Sequence[Call]) -> list[np.ndarray]:
        """Answer calls of one kind, each about the scene of its number."""
        return self._answer_batch(list(zip(picked(self._stack_places, numbers), calls, strict=True)))

    def _answer_batch(self, asked: Sequence[tuple[int, Call]]) -> list[np.ndarray]:
        """Answer at most `_max_calls` calls of one kind, each given with its scene's index in the stack."""
        padded = [*asked, *[asked[0]] * (self._max_calls - len(asked))]
        places = np.array([place for place, _ in padded], np.int32)
        columns = zip(*(call.arguments for _, call in padded), strict=True)
        arguments = [np.stack(column) for column in columns]
        answers = asked[0][1].kernel.answers(self._layout, self._vectors, places, len(asked), *arguments)
        return list(np.asarray(answers)[: len(asked)])


def picked(items: Sequence[Item], numbers: Sequence[int]) -> list[Item]:
    """Return the items at these indices, as a list."""
    return [items[number] for number in numbers]


def completed(
    answers: Sequence[Answer | None], answer: Callable[[list[int]], Sequence[Answer]]
) -> list[Answer]:
    """Fill in the missing ones of some answers, by one call of a function.

    Args:
        answers: the known ones, None where one is missing.
        answer: function from the indices of the missing ones to as many answers; not called where none is
            missing.

    Returns:
        All answers, in a new list.
    """
    missing = [number for number, one in enumerate(answers) if one is None]
    further = dict(zip(missing, answer(missing), strict=True)) if missing else {}
    return [further[number] if one is None else one for number, one in enumerate(answers)]
